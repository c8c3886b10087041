"""Parts that are pinned by hand: they come to be there, smoothly, the rest stays, and what cannot be is told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.cli import main
from hoi_retarget.clip.augment import at_speed, mirrored
from hoi_retarget.clip.clip import PINNED_PARTS, PosePin, pinned_path
from hoi_retarget.clip.edits import ContactEdits, Pin, Unpin, apply, load, save
from hoi_retarget.errors import ClipError, WriteError
from hoi_retarget.motion.result_file import load as load_motion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.readers.builtin_clips import builtin_clip
from hoi_retarget.readers.own_layout.own_arrays import encode
from hoi_retarget.retargeting.config import Config, Weights
from hoi_retarget.retargeting.local_resolve import resolve_locally
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.retargeting.site_pins import RAMP_SECONDS, site_pin
from hoi_retarget.retargeting.solve import Solution, solve
from hoi_retarget.retargeting.targets import (
    FEET,
    make_targets,
    pinned_parts,
    pinned_sites,
    recorded_rotation,
    with_pins,
)
from hoi_retarget.retargeting.trajopt.problem import cost
from hoi_retarget.retargeting.trajopt.terms.site_pose import pin_terms
from synthetic import make
from trajectories import MODELS

CONFIG = Config(contact="landmark")
FAST = settings(max_examples=60, deadline=None, derandomize=True, database=None)
FPS = 20.0
RAMP = seconds_to_frames(RAMP_SECONDS, FPS)
FRAMES = 80
NEAR = 0.005  # [m]; what is told as a miss is farther.


@pytest.fixture(scope="module")
def recorded():
    return make("carry_box", fps=FPS, seconds=6.0)


@pytest.fixture(scope="module", params=list(MODELS))
def before(request, recorded) -> tuple[Solution, object]:
    model = MODELS[request.param]
    return solve(recorded, model, CONFIG), model


def site_of(model, part: str) -> str:
    return {**model.spec.part_sites, "pelvis": "pelvis"}[part]


def shifted(before: Solution, model, part: str, frame: int, offset, turn=None) -> Pin:  # noqa: PLR0917
    """Return a pin that moves a part from where the robot has it."""
    place = model.forward(before.motion.qpos).site_position(site_of(model, part))[frame] + offset
    return Pin(part, frame, tuple((place / before.targets.root_scale).tolist()), turn, person=before.person)


def pinned(clip, *pins):
    edits = ContactEdits.of(clip)
    for pin in pins:
        edits = edits.adding(pin)
    return apply(clip, edits)


def path(rng, frames: int) -> tuple[np.ndarray, np.ndarray]:
    places = 0.02 * np.cumsum(rng.normal(size=(frames, 3)), axis=0)
    return places, se3.exp(0.05 * np.cumsum(rng.normal(size=(frames, 3)), axis=0))


@FAST
@given(
    frames=st.lists(st.integers(0, FRAMES - 1), min_size=1, max_size=5, unique=True).map(sorted),
    stance=st.lists(st.integers(0, FRAMES), min_size=0, max_size=6, unique=True).map(sorted),
    seed=st.integers(0, 9),
)
def test_a_pinned_path_leads_through_its_pins_smoothly_and_is_its_own_far_from_them(frames, stance, seed):
    rng = np.random.default_rng(seed)
    places, quats = path(rng, FRAMES)
    stands = np.zeros(FRAMES, dtype=bool)
    for first, stop in zip(stance[::2], stance[1::2], strict=False):
        stands[first:stop] = True
    pins = [PosePin(0, "left_foot", f, tuple(rng.normal(size=3)), tuple(20 * rng.normal(size=3))) for f in frames]
    made = site_pin("left_foot", pins, places, quats, scale=0.8, stands=stands, fps=FPS)
    assert made.frames == made.turned_frames == tuple(frames)
    np.testing.assert_allclose(made.positions[frames], [0.8 * np.array(pin.position) for pin in pins], atol=1e-12)
    turned = se3.quat_multiply(made.quats, se3.quat_conjugate(quats))
    asked = se3.exp(np.radians([pin.turn for pin in pins]))
    np.testing.assert_allclose(se3.angle_between(turned[frames], asked), 0.0, atol=1e-6)
    assert (made.weights[frames] == 1.0).all() and (made.weights <= 1.0).all()
    away = np.abs(np.arange(FRAMES)[:, None] - frames).min(axis=1)
    assert (made.weights[away > RAMP] == 0.0).all()
    # Horizontally a foot keeps its shift as long as it stands.
    held = np.isin(np.arange(FRAMES), frames)
    for first, stop in runs(stands):
        held[first:stop] |= any(first <= frame < stop for frame in frames)
    far = np.array([not held[max(0, t - RAMP) : t + RAMP + 1].any() for t in range(FRAMES)])
    between = (np.arange(FRAMES) > frames[0]) & (np.arange(FRAMES) < frames[-1])
    np.testing.assert_array_equal(made.positions[far & ~between], places[far & ~between])
    shift = made.positions - places
    for first, stop in runs(stands):
        if sum(first <= frame < stop for frame in frames) == 1:
            np.testing.assert_allclose(np.ptp(shift[first:stop, :2], axis=0), 0.0, atol=1e-12)
    # No step is larger than that of a cosine over the shortest way.
    largest = np.abs(shift).max() * np.pi
    if len(frames) == 1:
        assert np.abs(np.diff(shift, axis=0)).max() <= largest / RAMP


@pytest.mark.parametrize("stands", [False, True])
@pytest.mark.parametrize("frame", [0, FRAMES - 1])
def test_a_pin_in_the_first_or_last_frame_is_the_end_of_its_path(frame, stands):
    places, quats = path(np.random.default_rng(0), FRAMES)
    pin = PosePin(0, "left_foot", frame, (0.1, 0.2, 0.3), (0.0, 0.0, 30.0))
    made = site_pin("left_foot", [pin], places, quats, scale=0.8, stands=np.full(FRAMES, stands), fps=FPS)
    np.testing.assert_allclose(made.positions[frame], 0.8 * np.array(pin.position), atol=1e-12)
    away = np.abs(np.arange(FRAMES) - frame)
    shift = np.linalg.norm(made.positions - places, axis=1)
    assert (np.diff(shift[np.argsort(away)]) <= 1e-12).all() and (np.diff(made.weights[np.argsort(away)]) <= 0).all()
    assert made.weights[frame] == made.turn_weights[frame] == 1.0
    assert (made.weights[away == RAMP - 1] > 0).all() and (made.weights[away > RAMP] == 0).all()
    taken = made.take(slice(FRAMES // 2, None))
    np.testing.assert_array_equal(taken.positions, made.positions[FRAMES // 2 :])
    np.testing.assert_array_equal(taken.turn_weights, made.turn_weights[FRAMES // 2 :])


@pytest.mark.parametrize("part", PINNED_PARTS)
def test_the_first_and_the_last_frame_can_be_pinned_and_none_beyond(recorded, part):
    place = tuple(pinned_path(recorded.people[0], part)[0].tolist())
    for frame in (0, recorded.frames - 1):
        there = tuple(pinned_path(recorded.people[0], part)[frame].tolist())
        (pin,) = pinned(recorded, Pin(part, frame, there)).pins
        assert (pin.part, pin.frame, pin.position) == (part, frame, there)
        assert pinned(recorded, Pin(part, frame, there), Unpin(part, frame)).pins == ()
    with pytest.raises(ClipError):
        pinned(recorded, Pin(part, recorded.frames, place))
    for frame in (-1, recorded.frames):
        with pytest.raises(ClipError, match="names an absent person, part or frame"):
            replace(recorded, pins=(PosePin(0, part, frame, place),))


def test_without_pins_targets_are_the_same(recorded):
    model = MODELS["unitree_g1"]
    targets = make_targets(recorded, model, CONFIG.scaling)
    assert with_pins(targets, recorded, model, np.tile(model.home_qpos, (recorded.frames, 1))) is targets


@pytest.mark.parametrize("name", list(MODELS))
def test_pins_of_several_parts_are_those_of_each_alone(recorded, name):
    model = MODELS[name]
    targets = make_targets(recorded, model, CONFIG.scaling)
    standing = np.tile(model.home_qpos, (recorded.frames, 1))
    parts = [part for part in PINNED_PARTS if part in pinned_sites(model)]
    pins = []
    for part, frame, turn in [
        (part, 10 * (k + 1), (0.0, 5.0, 10.0) if k % 2 else None) for k, part in enumerate(parts)
    ]:
        place = pinned_path(recorded.people[0], part)[frame] + [0.0, 0.02, 0.03]
        pins.append(PosePin(0, part, frame, tuple(place.tolist()), turn))
    both = with_pins(targets, replace(recorded, pins=tuple(pins)), model, standing)
    assert both.unpinned is targets and [pin.site for pin in both.pins] == [site_of(model, part) for part in parts]
    for pin, made in zip(pins, both.pins, strict=True):
        alone = with_pins(targets, replace(recorded, pins=(pin,)), model, standing)
        assert made.frames == (pin.frame,) and made.turned_frames == ((pin.frame,) if pin.turn else ())
        for field in ("positions", "quats", "weights", "turn_weights"):
            np.testing.assert_array_equal(getattr(made, field), getattr(alone.pins[0], field))
        for side, foot in enumerate(FEET):
            expected = both if foot == made.site else targets
            np.testing.assert_array_equal(alone.foot_positions[:, side], expected.foot_positions[:, side])
            np.testing.assert_array_equal(alone.foot_quats[:, side], expected.foot_quats[:, side])
    kinematics = model.forward(standing)
    for pin, told in zip(pins, pinned_parts(kinematics, both), strict=True):
        place = kinematics.site_position(site_of(model, pin.part))[pin.frame]
        assert (told.part, told.frame) == (pin.part, pin.frame)
        assert told.off_m == pytest.approx(np.linalg.norm(place - targets.root_scale * np.array(pin.position)))
        if pin.turn is None:
            assert told.off_deg is None
        else:
            recorded_quat = recorded_rotation(both, kinematics, pin.part)[pin.frame]
            asked = se3.quat_multiply(se3.exp(np.radians(pin.turn)), recorded_quat)
            own = se3.matrix_to_quat(kinematics.site_rotation(site_of(model, pin.part))[pin.frame])
            assert told.off_deg == pytest.approx(np.degrees(se3.angle_between(own[None], asked[None])[0]), abs=1e-6)
    assert with_pins(targets, replace(recorded, pins=tuple(pins)), model, standing, person=1) is targets


@pytest.mark.parametrize("part", ["left_foot", "pelvis"])
def test_a_pinned_part_that_turns_costs_as_much_as_one_that_moves_a_decimetre_a_radian(recorded, part):
    model, frame = MODELS["unitree_g1"], 30
    standing = np.tile(model.home_qpos, (recorded.frames, 1))
    kinematics = model.forward(standing)
    place = tuple(pinned_path(recorded.people[0], part)[frame].tolist())
    clip = replace(recorded, pins=(PosePin(0, part, frame, place, (0.0, 0.0, 10.0)),))
    made = with_pins(make_targets(recorded, model, CONFIG.scaling), clip, model, standing)
    (pin,) = made.pins
    own = kinematics.site_position(pin.site), se3.matrix_to_quat(kinematics.site_rotation(pin.site))
    angle = 1e-3
    turned = replace(pin, positions=own[0], quats=se3.quat_multiply(own[1], se3.exp(np.array([0.0, 0.0, angle]))))
    moved = replace(pin, positions=own[0] + [0.1 * angle, 0.0, 0.0], quats=own[1])
    for only, name in ((turned, f"{pin.site}_pinned_rotation"), (moved, f"{pin.site}_pin")):
        terms = {term.name: term for term in pin_terms(Weights(pin=7.0), replace(made, pins=(only,)), kinematics)}
        costs = {key: sum(cost(rows) for rows in term.rows(kinematics)) for key, term in terms.items()}
        assert costs.pop(name) == pytest.approx(7.0 * (0.1 * angle) ** 2 * pin.weights.sum(), rel=1e-3)
        assert list(costs.values()) == [pytest.approx(0.0, abs=1e-20)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "frame", "offset", "turn"),
    [
        ("left_hand", 20, (0.0, 0.05, 0.1), (0.0, 0.0, 20.0)),
        ("right_hand", 60, (0.0, 0.0, 0.08), None),
        ("left_foot", 60, (0.0, 0.04, 0.0), (0.0, 0.0, 15.0)),
        ("right_foot", 20, (0.0, 0.0, 0.05), None),
        ("pelvis", 60, (0.03, 0.0, -0.06), None),
    ],
)
def test_a_pinned_part_comes_to_be_there_and_what_is_far_off_stays(before, part, frame, offset, turn):
    before, model = before
    clip = pinned(before.clip, shifted(before, model, part, frame, offset, turn))
    after = resolve_locally(before, clip, CONFIG, quickly=True)
    site = site_of(model, part)
    moved = [model.forward(item.motion.qpos).site_position(site) for item in (before, after)]
    assert np.linalg.norm(moved[1][frame] - moved[0][frame] - offset) < NEAR
    (told,) = after.motion.report.pins
    assert (told.part, told.frame) == (part, frame) and told.off_m < NEAR and not told.missed
    assert (told.off_deg is None) == (turn is None)
    away = np.abs(np.arange(clip.frames) - frame) > 2.5 * FPS
    np.testing.assert_array_equal(after.motion.qpos[away], before.motion.qpos[away])
    whole = retarget(clip, model, CONFIG)
    assert whole.report.pins[0].off_m < NEAR
    np.testing.assert_array_equal(resolve_locally(before, clip, CONFIG).motion.qpos, whole.qpos)
    assert not any("pin" in warning.code for warning in whole.warnings)
    back = resolve_locally(after, before.clip, CONFIG, quickly=True)
    np.testing.assert_allclose(back.motion.qpos, before.motion.qpos, atol=2e-2)
    assert back.motion.report.pins == ()


def test_what_a_pin_misses_is_told(before):
    before, model = before
    pin = shifted(before, model, "pelvis", 60, (0.0, 0.0, -0.3))
    motion = retarget(pinned(before.clip, pin), model, replace(CONFIG, weights=Weights(pin=10.0)))
    (told,) = motion.report.pins
    place = model.forward(motion.qpos).site_position("pelvis")[60]
    asked = before.targets.root_scale * np.array(pin.position)
    assert told.off_m == pytest.approx(np.linalg.norm(place - asked), abs=1e-9)
    assert told.off_m > 0.01
    (warning,) = [warning for warning in motion.warnings if warning.code == "missed_pin"]
    assert warning.text.startswith(f"pelvis in frame 60 is {1e3 * told.off_m:.0f} mm off its pin: ")


def test_a_later_pin_takes_the_place_of_an_earlier_one_and_can_be_taken_away(recorded):
    place = tuple(pinned_path(recorded.people[0], "left_hand")[9].tolist())
    higher = (place[0], place[1], place[2] + 0.1)
    assert [pin.position for pin in pinned(recorded, Pin("left_hand", 9, place), Pin("left_hand", 9, higher)).pins] == [
        higher
    ]
    assert pinned(recorded, Pin("left_hand", 9, place), Unpin("left_hand", 9)).pins == ()
    with pytest.raises(ClipError, match=r"edit 2 .*left_hand is not pinned in frame 8. Pinned: left_hand in frame 9"):
        pinned(recorded, Pin("left_hand", 9, place), Unpin("left_hand", 8))


@pytest.mark.slow
@FAST
@given(st.sampled_from(PINNED_PARTS), st.integers(0, 119), st.booleans(), st.integers(0, 99))
def test_pins_are_mirrored_and_sped_up_with_their_clip(part, frame, turned, seed):
    clip, rng = make("carry_box", fps=FPS, seconds=6.0), np.random.default_rng(seed)
    offset = rng.uniform(-0.3, 0.3, 3)
    turn = tuple(rng.uniform(-90, 90, 3).tolist()) if turned else None
    own = pinned_path(clip.people[0], part)[frame] + offset
    clip = replace(clip, pins=(PosePin(0, part, frame, tuple(own.tolist()), turn),))
    assert mirrored(mirrored(clip)).pins == clip.pins
    (pin,) = mirrored(clip).pins
    seen = pinned_path(mirrored(clip).people[0], pin.part)[frame] + offset * [1.0, -1.0, 1.0]
    np.testing.assert_allclose(pin.position, seen, atol=1e-9)
    (pin,) = at_speed(clip, 2.0).pins
    assert abs(2 * pin.frame - frame) <= 1.5 and pin.position == clip.pins[0].position


def test_a_clips_own_file_has_no_place_for_pins(recorded):
    place = tuple(pinned_path(recorded.people[0], "pelvis")[9].tolist())
    with pytest.raises(WriteError, match="no place for pins"):
        encode(pinned(recorded, Pin("pelvis", 9, place)), Path())


@pytest.mark.slow
def test_run_with_the_same_file_gives_the_same_motion_to_the_bit(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place = "pelvis:60:0.62,0.0,0.75:0,0,10"
    words = ["contacts", "builtin:carry_box", "--pin", "left_hand:40:0.7,0.25,0.9", place, "--out", "edits.toml"]
    assert main(words) == 0
    assert main(["run", "builtin:carry_box", "--edits", "edits.toml", "--out", "out", "--contact", "landmark"]) == 0
    clip = apply(builtin_clip("carry_box"), load(Path("edits.toml")))
    ours, theirs = retarget(clip, MODELS["unitree_g1"], CONFIG), load_motion(Path("out/carry_box.npz"))
    assert ours.qpos.tobytes() == theirs.qpos.tobytes()
    assert theirs.report.pins == ours.report.pins and len(ours.report.pins) == 2
    save(load(Path("edits.toml")), Path("again.toml"))
    assert Path("again.toml").read_bytes() == Path("edits.toml").read_bytes()


@pytest.mark.slow
def test_each_persons_pins_are_its_own():
    clip, model = make("carry_table", fps=15.0), MODELS["unitree_g1"]
    people = [solve(clip, model, CONFIG, person=person) for person in range(2)]
    edited = pinned(clip, shifted(people[1], model, "left_foot", 20, (0.0, 0.05, 0.0)))
    one, two = (resolve_locally(item, edited, CONFIG).motion for item in people)
    assert one.qpos.tobytes() == people[0].motion.qpos.tobytes() and one.report.pins == ()
    assert two.report.pins[0].off_m < NEAR
