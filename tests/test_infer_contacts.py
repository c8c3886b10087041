"""Floor and contacts of clips whose source leaves them open."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.cli import main
from hoi_retarget.clip.floor import FLOOR_REACH, WITNESS_TOLERANCE, floor_height, on_floor
from hoi_retarget.clip.infer_contacts import with_contacts
from hoi_retarget.clip.label_contacts import GUESSED_FINGERS, Proximity, label_contacts
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import stance
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.motion.result_file import load
from hoi_retarget.numerics import se3
from hoi_retarget.readers import own_layout
from hoi_retarget.readers.open import clip_of, open_clip
from synthetic import SCENES, make

CLIP = make("carry_box")


def shifted(clip, height):
    up = np.array([0.0, 0.0, height])
    return replace(
        clip,
        people=tuple(replace(person, joint_positions=person.joint_positions + up) for person in clip.people),
        objects=tuple(replace(track, positions=track.positions + up) for track in clip.objects),
    )


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("height", [0.0, -1.3, 0.4])
def test_the_floor_is_where_people_stand(scene, height):
    found, frames = floor_height(shifted(make(scene), height))
    assert found == pytest.approx(height, abs=0.035) and frames > 100


def test_the_floor_goes_up_with_the_clip_and_is_put_at_zero():
    base, raised = (on_floor(shifted(CLIP, height), at_zero=False) for height in (0.0, 0.7))
    for one, other in zip((*base.people, *base.objects), (*raised.people, *raised.objects), strict=True):
        name = "joint_positions" if hasattr(one, "joint_positions") else "positions"
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9)
    assert floor_height(raised)[0] == pytest.approx(0.0, abs=1e-9)
    assert any("estimated from" in note and "standing feet" in note for note in raised.source.notes)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("above", [-0.12, -0.07, 0.0, 0.07])
def test_what_rests_is_a_second_witness_of_the_floor(scene, above):
    """Feet that are mistaken by some centimetres are contradicted, and the advice puts what rests onto the floor."""
    clip = make(scene)
    lifted = np.array([0.0, 0.0, above])
    people = tuple(replace(person, joint_positions=person.joint_positions + lifted) for person in clip.people)
    wrong = shifted(replace(clip, people=people, contacts=()), 0.3)
    texts = [str(warning) for warning in on_floor(wrong, at_zero=False).source.warnings]
    off = 0.3 - floor_height(wrong)[0]
    assert bool(texts) == (abs(off) > WITNESS_TOLERANCE and off < FLOOR_REACH)
    if not texts:
        return
    advised = float(texts[0].split("--floor ")[1].split()[0])
    put = on_floor(wrong, at_zero=False, floor=advised)
    assert min(track.lowest[0] for track in put.objects) == pytest.approx(0.0, abs=0.005)
    assert not any("rests" in str(warning) for warning in put.source.warnings)
    assert on_floor(replace(wrong, objects=()), at_zero=False).source.warnings == ()


def test_a_promised_floor_stays_and_a_known_one_is_believed():
    assert on_floor(CLIP, at_zero=True) is CLIP
    for at_zero in (True, False):
        lowered = on_floor(CLIP, at_zero=at_zero, floor=0.25)
        np.testing.assert_allclose(lowered.objects[0].positions, CLIP.objects[0].positions - [0, 0, 0.25], atol=1e-12)
        assert "z = 0.250 m" in lowered.source.notes[-1]


def test_feet_that_never_stand_still_have_a_lowest_point():
    """On a sliding walkway nobody stands; the floor is then no lower than the lowest sole."""
    person = CLIP.people[0]
    slide = np.zeros((CLIP.frames, 1, 3))
    slide[:, 0, 0] = 3.0 * np.arange(CLIP.frames) / CLIP.fps
    height, frames = floor_height(
        replace(CLIP, people=(replace(person, joint_positions=person.joint_positions + slide),))
    )
    assert frames == 0 and height == pytest.approx(0.0, abs=0.05)


def test_contacts_are_found_only_where_the_source_has_none_or_others_are_asked_for():
    bare = replace(CLIP, contacts=())
    assert with_contacts(CLIP) is CLIP
    for clip, labels in ((bare, "auto"), (CLIP, "proximity")):
        found, wanted = with_contacts(clip, labels), label_contacts(clip)
        assert [(track.part, track.object) for track in found.contacts] == [(t.part, t.object) for t in wanted]
        for ours, theirs in zip(found.contacts, wanted, strict=True):
            np.testing.assert_array_equal(ours.active, theirs.active)
            np.testing.assert_array_equal(ours.contact_points, theirs.contact_points)
        assert any(note.startswith("Contacts are found from distances") for note in found.source.notes)
    assert with_contacts(nothing := replace(bare, objects=())) is nothing


def test_inverse_rotations_of_what_is_carried_are_refused_without_labels():
    """A box that is turned about another place than its own, far from the hands that carry it."""
    track = CLIP.objects[0]
    corner = np.array([0.5, 0.8, 0.0])
    geometry = replace(track.geometry, points=track.geometry.points - corner, mesh_path=None, faces=None)
    away = replace(track, positions=track.positions + se3.rotate(track.quats, corner), geometry=geometry)
    right = replace(CLIP, contacts=(), objects=(away,))
    assert not with_contacts(right).source.warnings
    wrong = replace(right, objects=(replace(away, quats=se3.quat_conjugate(away.quats)),))
    with pytest.raises(ClipError, match=r"rotations of 'box' are read wrongly.*--grasps warn"):
        with_contacts(wrong)
    (kept,) = with_contacts(wrong, grasps="warn").source.warnings
    assert "The rotations of 'box' are read wrongly" in kept.text
    (settled,) = with_contacts(wrong, readings=()).source.warnings
    assert "nobody within 10 cm" in settled.text, "a format that leaves nothing open"


def test_what_moves_alone_is_warned_of():
    track = CLIP.objects[0]
    alone = replace(track, positions=track.positions + np.array([0.0, 0.0, 2.0]))
    labelled = tuple(replace(contact, object=1) for contact in CLIP.contacts)
    for clip in (
        replace(CLIP, contacts=(), objects=(alone,)),
        replace(CLIP, contacts=labelled, objects=(alone, replace(track, name="other"))),
    ):
        texts = [str(warning) for warning in with_contacts(clip, "proximity").source.warnings]
        assert any("box moves in" in text and "nobody within 10 cm" in text for text in texts)


def beside(track, offset, name, sway=0.0):
    """Return an object that keeps its place beside another one, but for some swaying [m]."""
    swaying = sway * np.sin(2 * np.pi * np.arange(CLIP.frames) / CLIP.fps)[:, None] * [1.0, 0.0, 0.0]
    return replace(track, name=name, positions=track.positions + se3.rotate(track.quats, offset + swaying))


def test_what_rides_on_something_held_is_moved_by_who_holds_it():
    """Clothes on a rack, and what hangs from these; not what moves along at a distance, or on what nobody holds."""
    box = CLIP.objects[0]
    away = -box.to_object(CLIP.people[0].position("pelvis")).mean(axis=0)
    away *= 0.6 / np.linalg.norm(away)
    shirt, scarf = (beside(box, count * away, name, 0.02 * count) for count, name in ((1, "shirt"), (2, "scarf")))
    assert not with_contacts(replace(CLIP, contacts=(), objects=(box, shirt, scarf))).source.warnings
    (far,) = with_contacts(replace(CLIP, contacts=(), objects=(box, scarf))).source.warnings
    assert far.text.startswith("scarf moves in")
    alone = (beside(box, np.array([0.0, 0.0, 3.0]), "rack"), beside(box, np.array([0.0, 0.0, 3.4]), "shirt"))
    texts = [warning.text for warning in with_contacts(replace(CLIP, contacts=(), objects=alone)).source.warnings]
    assert [text.split()[0] for text in texts] == ["rack", "shirt"]


def test_what_the_trunk_pushes_is_not_said_to_move_alone():
    person, box = CLIP.people[0], CLIP.objects[0]
    half = 0.1 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    cushion = replace(box.geometry, points=half, mesh_path=None, faces=None)
    behind = person.position("pelvis") + se3.rotate(person.quat("pelvis"), np.array([0.0, 0.1, -0.25]))
    leaned = replace(CLIP, contacts=(), objects=(replace(box, geometry=cushion, positions=behind),))
    found = with_contacts(leaned)
    assert not found.source.warnings and not any(track.active.any() for track in found.contacts)
    assert "other parts of the body than hands and feet" in found.source.notes[-1]


@pytest.mark.slow
def test_results_open_their_clip_as_it_was_read(tmp_path, capsys):
    path = tmp_path / "bare.npz"
    own_layout.write(replace(shifted(CLIP, 0.3), contacts=()), path)
    assert main(["run", str(path), "--floor", "0.3", "--labels", "proximity", "--out", str(tmp_path / "out")]) == 0
    motion = load(tmp_path / "out" / "bare.npz")
    again, direct = clip_of(motion), open_clip(path, ReadOptions(floor=0.3, labels="proximity"))
    np.testing.assert_array_equal(again.objects[0].positions, direct.objects[0].positions)
    assert [track.active.sum() for track in again.contacts] == [track.active.sum() for track in direct.contacts]
    assert motion.contact_flags.any() and motion.report.figures["touch_gap_p95_m"] < 0.01
    capsys.readouterr()
    assert main(["inspect", str(path)]) == 0
    assert "none in the file; found from distances" in capsys.readouterr().out


def test_what_moves_untouched_and_feet_off_the_floor_are_warnings_that_run_tells(tmp_path, capsys):
    none = tuple(replace(track, active=np.zeros(CLIP.frames, dtype=bool)) for track in CLIP.contacts)
    (warning,) = with_contacts(replace(CLIP, contacts=none)).source.warnings
    assert "Nobody touches anything, although box moves in" in warning.text
    assert not with_contacts(CLIP).source.warnings
    (warning,) = on_floor(shifted(CLIP, 1.0), at_zero=True).source.warnings
    assert "Feet stand at z = 0.97 m" in warning.text and "--floor 0.97" in warning.text
    (warning,) = on_floor(shifted(CLIP, 1.0), at_zero=False, floor=0.5).source.warnings
    assert "--floor 0.97" in warning.text
    assert not on_floor(shifted(CLIP, 1.0), at_zero=False, floor=1.0).source.warnings
    path = tmp_path / "high.npz"
    own_layout.write(shifted(CLIP, 1.0), path)
    assert main(["run", str(path), "--contact", "landmark", "--out", str(tmp_path)[:-1] + "x"]) == 1
    err = capsys.readouterr().err
    assert "warning: high.npz: Feet stand at z = 0.97 m" in err, "the cause comes before its effects"
    assert err.index("warning: high.npz:") < err.index("error: orientation flip")


def test_feet_that_stand_beside_an_object_do_not_touch_it():
    person, track = CLIP.people[0], CLIP.objects[0]
    beside = replace(track, positions=person.position("left_foot"))  # The foot is in it all the time.
    flags = {contact.part: contact.active for contact in label_contacts(replace(CLIP, objects=(beside,), contacts=()))}
    stands = stance(person, CLIP.fps)[:, 0]
    assert not (flags["left_foot"] & stands).any() and flags["left_foot"].any(), "it does when it swings"


def test_hands_without_recorded_fingers_touch_from_farther():
    person = CLIP.people[0]
    bare = replace(CLIP, contacts=())
    guessed = replace(bare, people=(replace(person, fingers_recorded=False),))
    wider = label_contacts(bare, rule=Proximity(touch=0.010 + GUESSED_FINGERS, release=0.015 + GUESSED_FINGERS))
    for ours, theirs in zip(label_contacts(guessed), wider, strict=True):
        if ours.part in HANDS:
            np.testing.assert_array_equal(ours.active, theirs.active)
