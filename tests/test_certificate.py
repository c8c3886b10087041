"""Laws of certificates: what is replayed is what was performed, and what has no feedback does not stand a push."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from controller_files import read_controller_file
from hoi_retarget.dynamics.physics_scene import compiled
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.motion.motion import Stage
from hoi_retarget.motion.motion_report import Report
from hoi_retarget.motion.performance import MAX_BASE_DISTANCE_M, MAX_OBJECT_DISTANCE_M, Certificate, Performance, Replay
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.simulation.certificate import certificate_of
from hoi_retarget.simulation.control import EFFORTS, feedback_gains, rollout_gains
from hoi_retarget.simulation.physics_stage import _certified
from hoi_retarget.simulation.refine import Refined
from hoi_retarget.simulation.rollout import drive_targets, track
from hoi_retarget.simulation.tracking_result import controller_file
from plain_motions import plain_motion, standing_qpos
from test_rollout import G1, staged

LENGTHS = st.floats(0.0, 1.0)
WORDS = st.sampled_from(["", "push", 'a; "b" \u00fc'])
REPLAYS = st.lists(st.tuples(WORDS, LENGTHS, st.booleans(), st.none() | LENGTHS, LENGTHS), max_size=3)


@cache
def stood():
    """A robot that stands for two and a half seconds beside a box."""
    motion, scene, reference = staged(standing_qpos(G1, 76))
    simulated = compiled(scene)
    rollout = track(simulated, reference, drive_targets(scene, reference))
    return motion, scene, rollout, feedback_gains(scene, simulated, reference)


@given(seconds=LENGTHS, fell=st.booleans(), cause=WORDS, replays=st.none() | REPLAYS)
def test_what_is_written_is_what_is_read(seconds, fell, cause, replays):
    certificate = None if replays is None else Certificate(fell, tuple(Replay(*values) for values in replays))
    performance = Performance(seconds, fell, cause, certificate)
    report = Report.from_json(json.loads(json.dumps(Report(performance=performance).as_json())))
    assert report.performance == performance


def test_a_result_keeps_it(tmp_path):
    motion = plain_motion(G1, standing_qpos(G1, 3))
    performance = Performance(1.0, False, "", Certificate(True, (Replay("push", 1.0, False, None, 0.01),)))
    performed = replace(
        motion,
        stages=(*motion.stages, Stage("physics", motion.qpos)),
        report=replace(motion.report, performance=performance),
    )
    save(performed, tmp_path / "performed.npz")
    assert load(tmp_path / "performed.npz").report.performance == performance
    save(motion, tmp_path / "plain.npz")
    assert load(tmp_path / "plain.npz").report.performance is None


def test_a_file_for_controllers_gives_its_certificate_again(tmp_path):
    motion, scene, rollout, gains = stood()
    certificate = certificate_of(scene, rollout, gains)
    refined, performance = Refined(rollout, gains, 0), Performance(rollout.seconds, False, "", certificate)
    content = controller_file(motion, scene, refined, performance, settings=Refinement(), seed=0)
    (tmp_path / "stands.npz").write_bytes(content)
    stored, stored_gains, stored_certificate, _ = read_controller_file(tmp_path / "stands.npz")
    assert stored_certificate == certificate == certificate_of(scene, stored, stored_gains)
    uncertain = controller_file(
        motion, scene, refined, replace(performance, certificate=None), settings=Refinement(), seed=0
    )
    (tmp_path / "uncertain.npz").write_bytes(uncertain)
    assert read_controller_file(tmp_path / "uncertain.npz")[2] is None


def test_a_replay_without_a_change_is_the_motion_to_the_bit():
    _, scene, rollout, gains = stood()
    assert certificate_of(scene, rollout, gains).repeats
    targets = rollout.targets.copy()
    targets[3, 0] += 1e-9
    assert not certificate_of(scene, replace(rollout, targets=targets), gains).repeats


def test_with_feedback_a_standing_robot_stands_all_and_without_it_falls_when_pushed():
    _, scene, rollout, gains = stood()
    certificate = certificate_of(scene, rollout, gains)
    assert certificate.passed and len(certificate.replays) == 7
    assert str(certificate) == "7 of 7 replays keep to the motion"
    pushed, *_ = [replay for replay in certificate.replays if replay.name.startswith("push")]
    assert 0.0 < pushed.base_m < MAX_BASE_DISTANCE_M and pushed.seconds == rollout.seconds
    alone = certificate_of(scene, rollout, np.zeros_like(gains))
    (fallen,) = [replay for replay in alone.replays if replay.name == pushed.name]
    assert fallen.fell and fallen.seconds < rollout.seconds
    assert f"{fallen.name} falls at {fallen.seconds:.1f} s" in str(alone) and not alone.passed


def test_the_feedback_is_the_calmer_one_only_where_more_replays_keep_to_the_motion_then():
    _, scene, rollout, gains = stood()
    usual, chosen = _certified(scene, rollout, gains)
    assert usual.passed and chosen is gains
    without = np.zeros_like(gains)
    certificate, chosen = _certified(scene, rollout, without)
    assert certificate.kept > certificate_of(scene, rollout, without).kept
    assert np.array_equal(chosen, rollout_gains(scene, rollout, EFFORTS[1]))
    assert np.abs(chosen).mean() < np.abs(rollout_gains(scene, rollout)).mean()


@given(fell=st.booleans(), object_m=st.none() | LENGTHS, base_m=LENGTHS)
def test_a_replay_is_kept_where_nothing_falls_or_goes_astray(fell, object_m, base_m):
    replay = Replay("", 1.0, fell, object_m, base_m)
    assert replay.kept == (not fell and (object_m or 0.0) <= MAX_OBJECT_DISTANCE_M and base_m <= MAX_BASE_DISTANCE_M)
    assert Certificate(True, (replay,)).passed == replay.kept
    assert not Certificate(False, (replay,)).passed
