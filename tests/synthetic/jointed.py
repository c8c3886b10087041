"""Scenes of objects with joints, whose axes, anchors and angles are known: a door pushed open, a laptop opened."""

import numpy as np

from hoi_retarget.clip.clip import Clip, Source
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectJoint, ObjectTrack
from synthetic.acting import Actor, Grip, act, contacts_of
from synthetic.object_shapes import Block, Shape
from synthetic.staging import StagedScene, holds, upright
from synthetic.walking import Place, Times, Walk, keyed

HEIGHT = 1.75
POST, OPENING, LINTEL = 0.06, 1.04, 2.05
FRAME = Shape(
    "frame",
    (0.1, OPENING + 2 * POST, LINTEL + POST),
    (
        Block((-0.05, -OPENING / 2 - POST, 0.0), (0.05, -OPENING / 2, LINTEL)),
        Block((-0.05, OPENING / 2, 0.0), (0.05, OPENING / 2 + POST, LINTEL)),
        Block((-0.05, -OPENING / 2 - POST, LINTEL), (0.05, OPENING / 2 + POST, LINTEL + POST)),
    ),
)
PANEL = Shape("door", (0.04, 1.0, 2.0), (Block((-0.02, -0.5, 0.0), (0.02, 0.5, 2.0)),))
BASE = Shape("base", (0.24, 0.34, 0.02), (Block((-0.12, -0.17, 0.0), (0.12, 0.17, 0.02)),))
LID = Shape("lid", (0.24, 0.34, 0.01), (Block((-0.12, -0.17, 0.0), (0.12, 0.17, 0.01)),))
STAND = Shape("stand", (0.22, 0.6, 0.8), (Block((-0.11, -0.3, 0.0), (0.11, 0.3, 0.8)),))
HINGE, AXIS = np.array([0.0, 0.6, 1.01]), np.array([0.0, 0.0, 1.0])  # Of the door in the world.
ABOVE = 0.8 + 0.02 + 0.005  # Height of the middle of the closed lid.
DOOR_ANGLE, LID_ANGLE = 0.7, 1.2  # [rad]


def open_door() -> tuple[Clip, np.ndarray]:
    """Push a door open with the right hand while walking on; the angle of the door over time [rad] is the truth."""
    touch = 1.4
    begin = Place(-0.5, 0.0)
    walk = Walk(begin).along(begin.line_to(begin.ahead(0.38)), start=touch + 0.2, count=3)
    release = walk.end + 0.4

    def angle(times: Times) -> np.ndarray:
        return keyed(times, ((touch + 0.1, 0.0), (release - 0.1, DOOR_ANGLE)))

    def objects(times: Times) -> tuple[ObjectTrack, ...]:
        quats = upright(angle(times))
        places = HINGE + se3.rotate(quats, np.array([[0.0, -0.5, 0.0]]))
        still = np.tile([0.0, 0.1, FRAME.half[2]], (len(times), 1))
        frame = ObjectTrack(FRAME.name, still, upright(0.0 * times), FRAME.geometry, ObjectJoint("", "fixed"))
        anchor = HINGE - still[0]
        joint = ObjectJoint(FRAME.name, "hinge", (0.0, 0.0, 1.0), tuple(anchor.tolist()))
        return ObjectTrack(PANEL.name, places, quats, PANEL.geometry, joint), frame

    grip = Grip(1, (-0.02, -0.34, 0.05), outward=(-1.0, 0.0, 0.0), fingers=(0.0, 0.2, 1.0), span=(touch, release))
    scene = StagedScene(release + 1.0, 0.0, (Actor("person", HEIGHT, walk, (grip,)),), objects)
    return filmed("open_door", scene), angle(_times(scene))


def open_laptop() -> tuple[Clip, np.ndarray]:
    """Lift the lid of a laptop on a stand by its front edge, and press it back; beside it the lid's angle [rad]."""
    touch, release = 1.4, 3.4
    place = Place(-0.5, 0.12)

    def angle(times: Times) -> np.ndarray:
        return keyed(times, ((touch + 0.1, 0.0), (release - 0.1, LID_ANGLE)))

    def objects(times: Times) -> tuple[ObjectTrack, ...]:
        quats = se3.exp(angle(times)[:, None] * np.array([0.0, 1.0, 0.0]))
        anchor = np.array([0.12, 0.0, ABOVE])
        lid = anchor + se3.rotate(quats, np.array([[-0.12, 0.0, 0.0]]))
        own, flat = np.array([0.0, 0.0, 0.81]), upright(0.0 * times)
        joint = ObjectJoint(BASE.name, "hinge", (0.0, 1.0, 0.0), tuple((anchor - own).tolist()))
        return (
            ObjectTrack(LID.name, lid, quats, LID.geometry, joint),
            ObjectTrack(BASE.name, np.tile(own, (len(times), 1)), flat, BASE.geometry),
            ObjectTrack(STAND.name, np.tile([0.0, 0.0, 0.4], (len(times), 1)), flat, STAND.geometry),
        )

    grip = Grip(1, (-0.12, 0.0, 0.0), outward=(-1.0, 0.0, 0.0), fingers=(0.3, 0.0, 1.0), span=(touch, release))
    lean = holds(((touch, release),), 0.25)
    scene = StagedScene(4.6, 0.0, (Actor("person", HEIGHT, Walk(place), (grip,), lean=lean),), objects)
    return filmed("open_laptop", scene), angle(_times(scene))


def filmed(name: str, scene: StagedScene) -> Clip:
    """Return the clip of a scene at 30 frames a second."""
    times = _times(scene)
    objects = scene.objects(times)
    people = tuple(act(actor, times, objects) for actor in scene.actors)
    contacts = tuple(track for index, actor in enumerate(scene.actors) for track in contacts_of(actor, index, times))
    return Clip(name, 30.0, people, objects, contacts, Source(format="synthetic", licence="ours"))


def _times(scene: StagedScene) -> np.ndarray:
    return np.arange(round(30 * scene.there)) / 30.0
