"""Contact labels in the layouts that policies take: by link, by end effector, and with a neutral time between."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from export_motions import as_result
from hoi_retarget.motion.contact_arrays import END_EFFECTORS, contact_arrays
from hoi_retarget.motion.formats import read
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.write_export import write_export
from hoi_retarget.robots import load_robot
from trajectories import MODELS

G1 = MODELS["unitree_g1"]


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), fps=st.sampled_from([30.0, 50.0, 100.0]))
def test_neutral_is_near_a_touch_in_time_and_apart_is_not(seed, fps):
    resampled = resample(as_result(G1, objects=1, seed=seed).motion, G1, fps)
    arrays = contact_arrays(resampled, {})
    flags, labels = arrays["contact_flags"], arrays["contact_ternary"]
    assert set(np.unique(labels)) <= {-1, 0, 1} and labels.dtype == np.int8
    np.testing.assert_array_equal(labels == 1, flags)
    times = np.arange(len(flags)) / fps
    for link in range(flags.shape[1]):
        touches = times[flags[:, link]]
        away = np.abs(times[:, None] - touches).min(axis=1, initial=np.inf)
        np.testing.assert_array_equal(labels[:, link] == -1, away > 0.2 + 1e-6)


def test_a_hand_is_closed_around_what_any_of_its_links_touches():
    links = ("left_palm", "left_thumb", "right_palm", "left_foot")
    flags = np.zeros((40, 4), dtype=bool)
    flags[20:25, 1] = flags[30:, 3] = True
    values = {"contact_links": links, "contact_flags": flags, "contact_object": np.where(flags, 0, -1)}
    points = np.where(flags[:, :, None], 0.1, np.nan)
    model = load_robot("unitree_g1_dex3")
    motion = as_result(model, contact_points=np.tile(points, (1, 1, 3)).reshape(40, 4, 3), fps=50.0, **values).motion
    closed = contact_arrays(resample(motion, model, 50.0), {})["contact_hand_closed"]
    np.testing.assert_array_equal(np.flatnonzero(closed[:, 0]), np.arange(10, 35))
    assert not closed[:, 1].any(), "a foot that touches closes no hand"


def test_a_motion_without_contact_links_has_arrays_of_the_same_shapes():
    none = np.zeros((40, 0))
    values = {"contact_flags": none > 0, "contact_object": none.astype(int), "contact_points": np.zeros((40, 0, 3))}
    motion = as_result(G1, objects=0, contact_links=(), **values).motion
    resampled = resample(motion, G1, 50.0)
    bare, full = contact_arrays(resampled, {}), contact_arrays(resample(as_result(G1).motion, G1, 50.0), {})
    for name in ("contact_hand_closed", "contact_info"):
        assert (bare[name].shape, bare[name].dtype) == (full[name].shape, full[name].dtype) and not bare[name].any()
    assert bare["contact_ternary"].shape == (resampled.frames, 0)


def test_end_effectors_touch_as_their_links_do():
    resampled = resample(as_result(G1, objects=1, seed=3).motion, G1, 50.0)
    arrays = contact_arrays(resampled, {})
    links = resampled.motion.contact_links
    assert arrays["contact_info"].shape == (resampled.frames, 4, 1)
    for column, part in enumerate(END_EFFECTORS):
        site = G1.spec.part_sites[part]
        expected = resampled.contact_flags[:, links.index(site)] if site in links else 0.0
        np.testing.assert_array_equal(arrays["contact_info"][:, column, 0], expected)


def test_tracking_files_are_read_back_with_their_contacts(tmp_path):
    result = as_result(G1, objects=1, seed=3)
    path, _ = write_export(result.motion, "mjlab", tmp_path)
    contacts = read(path).contacts
    assert contacts is not None and contacts.names == END_EFFECTORS and contacts.flags.any()
