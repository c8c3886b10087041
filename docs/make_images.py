"""Draws the pictures of the documentation from the built-in clip: `python docs/make_images.py`.

Needs EGL (Debian: `apt-get install libegl1 libgl1-mesa-dri`) or a display; on a machine without a
display run it with `MUJOCO_GL=egl`.
"""

from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from hoi_retarget import se3
from hoi_retarget.clip import Clip
from hoi_retarget.motion import Motion
from hoi_retarget.pipeline import Config, retarget
from hoi_retarget.robots import robot
from hoi_retarget.robots.model import load_model
from hoi_retarget.skeleton import JOINTS, PARENT
from hoi_retarget.synthetic import make

IMAGES = Path(__file__).parent / "images"
PANELS, WIDTH, HEIGHT = 6, 290, 340
SKIN, CARDBOARD, CONTACT = (0.85, 0.55, 0.4, 1.0), (0.72, 0.53, 0.32, 1.0), (0.1, 0.75, 0.3, 1.0)


def main() -> None:
    """Write `images/overview.png`: the human above, the robot below, the palms' contact points marked."""
    clip = make("carry_box")
    model = load_model(robot("unitree_g1"))
    motion = retarget(clip, model, Config())
    frames = np.linspace(0.12, 0.97, PANELS) * (clip.frames - 1)
    with_robot = _Stage(motion, robot_file=model.spec.mjcf)
    above = [_human_panel(_Stage(motion, robot_file=None), clip, frame) for frame in frames.astype(int)]
    below = [_robot_panel(with_robot, motion, frame) for frame in frames.astype(int)]
    picture = np.concatenate([np.concatenate(above, axis=1), np.concatenate(below, axis=1)])
    IMAGES.mkdir(exist_ok=True)
    Image.fromarray(picture).save(IMAGES / "overview.png", optimize=True)


class _Stage:
    """A floor, lights, and perhaps a robot, seen from the side; more shapes are added by frame."""

    def __init__(self, motion: Motion, *, robot_file: Path | None) -> None:
        spec = mujoco.MjSpec.from_file(str(robot_file)) if robot_file else mujoco.MjSpec()
        spec.visual.global_.offwidth, spec.visual.global_.offheight = WIDTH, HEIGHT
        spec.visual.quality.shadowsize = 8192
        # The scene is small: a shadow map and a depth range that fit it leave no speckles.
        spec.stat.extent, spec.stat.center = 1.5, [0, 0, 0.7]
        spec.visual.map.znear, spec.visual.map.zfar, spec.visual.map.shadowclip = 0.05, 30.0, 3.0
        sky = {"type": mujoco.mjtTexture.mjTEXTURE_SKYBOX, "builtin": mujoco.mjtBuiltin.mjBUILTIN_GRADIENT}
        spec.add_texture(name="sky", rgb1=[1, 1, 1], rgb2=[0.9, 0.92, 0.95], width=64, height=64, **sky)
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[9, 9, 0.1], rgba=[0.93, 0.94, 0.95, 1])
        sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        spec.worldbody.add_light(type=sun, pos=[0, 0, 5], dir=[0.5, 0.3, -1], diffuse=[0.5] * 3, castshadow=True)
        self.compiled = spec.compile()
        self.compiled.vis.headlight.ambient[:] = 0.5
        self.compiled.vis.headlight.diffuse[:] = 0.35
        self.data = mujoco.MjData(self.compiled)
        self.renderer = mujoco.Renderer(self.compiled, HEIGHT, WIDTH)
        self.camera = mujoco.MjvCamera()
        self.camera.azimuth, self.camera.elevation, self.camera.distance = 135.0, -12.0, 2.75

    def look_at(self, point: np.ndarray, height: float) -> None:
        """Begin a frame: the camera turns to a point of the floor plan."""
        self.camera.lookat[:] = point[0], point[1], height
        mujoco.mj_forward(self.compiled, self.data)
        self.renderer.update_scene(self.data, self.camera)

    def shape(self, kind: int, size: np.ndarray, place: np.ndarray, rotation: np.ndarray, color: tuple) -> None:
        """Add one shape to the frame."""
        scene = self.renderer.scene
        mujoco.mjv_initGeom(scene.geoms[scene.ngeom], kind, size, place, rotation.ravel(), np.float32(color))
        scene.geoms[scene.ngeom].emission = 0.25
        scene.ngeom += 1

    def dot(self, place: np.ndarray, radius: float, color: tuple) -> None:
        """Add a ball."""
        self.shape(mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, radius), place, np.eye(3), color)

    def stick(self, begin: np.ndarray, end: np.ndarray, radius: float, color: tuple) -> None:
        """Add a capsule between two points."""
        scene = self.renderer.scene
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.eye(3).ravel(), color)
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, begin, end)
        scene.ngeom += 1

    def box(self, points: np.ndarray, place: np.ndarray, quat: np.ndarray, scale: float) -> None:
        """Add the box that bounds an object's points."""
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, np.array(quat))
        low, high = scale * points.min(axis=0), scale * points.max(axis=0)
        middle = place + rotation.reshape(3, 3) @ (0.5 * (low + high))
        self.shape(mujoco.mjtGeom.mjGEOM_BOX, 0.5 * (high - low), middle, rotation, CARDBOARD)

    def picture(self) -> np.ndarray:
        """Return the frame."""
        return self.renderer.render().copy()


def _human_panel(stage: _Stage, clip: Clip, frame: int) -> np.ndarray:
    joints, track = clip.people[0].joint_positions[frame], clip.objects[0]
    stage.look_at(0.5 * (joints[0] + track.positions[frame]), 0.8)
    for joint, parent in PARENT.items():
        if parent is not None:
            thickness = 0.012 if "_" in joint and joint[-1].isdigit() else 0.035
            stage.stick(joints[JOINTS.index(parent)], joints[JOINTS.index(joint)], thickness, SKIN)
    stage.dot(joints[JOINTS.index("head")] + [0, 0, 0.08], 0.1, SKIN)
    stage.box(track.geometry.points, track.positions[frame], track.quats[frame], 1.0)
    for contact in clip.contacts:
        if contact.active[frame]:
            stage.dot(clip.people[0].part_position(contact.part)[frame], 0.045, CONTACT)
    return stage.picture()


def _robot_panel(stage: _Stage, motion: Motion, frame: int) -> np.ndarray:
    stage.data.qpos[:] = motion.qpos[frame]
    place, quat = motion.object_pos[frame, 0], motion.object_quat[frame, 0]
    stage.look_at(0.5 * (motion.qpos[frame, :3] + place), 0.65)
    points = make("carry_box").objects[0].geometry.points
    stage.box(points, place, quat, motion.object_scale[0])
    for column in range(len(motion.contact_links)):
        if motion.contact_flags[frame, column]:
            target = place + se3.rotate(quat, motion.contact_targets[frame, column])
            stage.dot(target, 0.06, CONTACT)
    return stage.picture()


if __name__ == "__main__":
    main()
