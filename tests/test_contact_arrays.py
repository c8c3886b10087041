"""Contact labels in the layouts that policies take: by link, by end effector, and with a neutral time between."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from export_motions import as_result
from hoi_retarget.motion.contact_arrays import END_EFFECTORS, contact_arrays
from hoi_retarget.motion.formats import read
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.write_export import write_export
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
