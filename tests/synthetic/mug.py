"""A mug that a hand grasps from the side, raises from a stand and tilts: fingers around a round thing."""

import numpy as np
import trimesh

from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from synthetic.acting import Actor, Grip
from synthetic.jointed import HEIGHT, filmed
from synthetic.object_shapes import Block, Shape
from synthetic.staging import StagedScene, upright
from synthetic.walking import Place, Times, Walk, keyed

STAND = Shape("stand", (0.3, 0.6, 0.9), (Block((-0.15, -0.3, 0.0), (0.15, 0.3, 0.9)),))
RADIUS, TALL = 0.03, 0.1  # Of the mug [m].
RAISED, TILTED = 0.22, 0.5  # [m], [rad]


def raise_mug() -> Clip:
    """Grasp the mug with the right hand, raise and tilt it as for drinking, and put it back."""
    touch, release = 1.4, 4.4
    body = trimesh.creation.cylinder(RADIUS, TALL, sections=48)
    mug = ObjectGeometry(np.asarray(body.vertices), faces=np.asarray(body.faces))

    def objects(times: Times) -> tuple[ObjectTrack, ...]:
        up = ((touch + 0.2, 0.0), (touch + 1.2, RAISED), (release - 1.2, RAISED), (release - 0.2, 0.0))
        over = ((touch + 0.8, 0.0), (touch + 1.4, TILTED), (release - 1.4, TILTED), (release - 0.8, 0.0))
        rise, quats = keyed(times, up), se3.exp(keyed(times, over)[:, None] * np.array([0.0, -1.0, 0.0]))
        places = np.stack([-0.36 * rise, 0.0 * times - 0.1, 0.9 + 0.5 * TALL + rise], axis=1)
        stand = np.tile([0.05, -0.1, 0.45], (len(times), 1))
        return (
            ObjectTrack("mug", places, quats, mug),
            ObjectTrack(STAND.name, stand, upright(0.0 * times), STAND.geometry),
        )

    # The middle of the bent hand is in the mug, so that fingers lie around it, within 7 mm.
    grip = Grip(
        1,
        (-0.02, 0.02 - RADIUS, 0.0),
        outward=(0.0, -1.0, 0.0),
        fingers=(1.0, 0.0, 0.0),
        span=(touch, release),
        curl=0.75,
    )
    return filmed(
        "raise_mug", StagedScene(5.6, 0.0, (Actor("person", HEIGHT, Walk(Place(-0.4, 0.05)), (grip,)),), objects)
    )
