"""The stage on which MuJoCo draws off-screen: floor, sky, lights, and whether anything can be drawn.

MuJoCo reads how to draw (`MUJOCO_GL`: egl, osmesa or glfw) from the environment when it is imported;
whoever starts the program chooses it, nothing here does.
"""

import warnings
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import DrawingError

_HORIZON = 60.0  # The floor fades into the sky before it [m].
_SKY, _FLOOR = (0.93, 0.945, 0.96), ((0.845, 0.86, 0.88), (0.812, 0.83, 0.853))
# Where the lights shine to: to the right of the camera, up, ahead of it.
_SUN, _FILL = np.array([0.5, -1.3, 0.45]), np.array([-0.8, -0.5, 0.6])
# A shadow glows in its own colour: lights would find what is left of the shapes' roundness.
_SHADOW, _GLOW = np.array([0.0138, 0.0141, 0.0144, 1.0], dtype=np.float32), 50.0
_SHADOW_HEIGHT, _SHADOW_SLOPE = 0.0015, 1e-4
# How MuJoCo and its OpenGL bindings fail when there is no way to draw: a library that is missing
# (ImportError, OSError, AttributeError) or one that finds no device (RuntimeError, FatalError).
_CANNOT_DRAW = (ImportError, OSError, AttributeError, RuntimeError, mujoco.FatalError)


@dataclass(frozen=True)
class Quality:
    """How smooth edges and round shapes are drawn."""

    samples: int  # Of a pixel.
    slices: int  # Of a round shape, around its axis.


FINE, UNSMOOTHED, QUICK = Quality(8, 24), Quality(0, 24), Quality(0, 10)
"""For pictures; for those that are made smaller, and the same in a third of the time."""


def add_floor_and_lights(spec: mujoco.MjSpec, width: int, height: int, quality: Quality) -> None:
    """Add floor, sky and lights to a model for pictures.

    `spec`: the model; `width`: of a picture [px]; `height`: of a picture [px]; `quality`: smoothness of edges and round
    shapes.
    """
    texture, builtin = mujoco.mjtTexture, mujoco.mjtBuiltin
    sky = {"builtin": builtin.mjBUILTIN_GRADIENT, "rgb1": _SKY, "rgb2": _SKY, "width": 64, "height": 64 * 6}
    floor = {"builtin": builtin.mjBUILTIN_CHECKER, "rgb1": _FLOOR[0], "rgb2": _FLOOR[1], "width": 512, "height": 512}
    spec.add_texture(name="stage_sky", type=texture.mjTEXTURE_SKYBOX, **sky)
    spec.add_texture(name="stage_floor", type=texture.mjTEXTURE_2D, **floor)
    material = spec.add_material(name="stage_floor", texrepeat=[2, 2], texuniform=True, specular=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "stage_floor"
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(type=plane, size=[0, 0, 0.1], material="stage_floor", contype=0, conaffinity=0)
    for name, strength in (("stage_sun", 0.5), ("stage_fill", 0.2)):
        spec.worldbody.add_light(
            name=name,
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            diffuse=[strength] * 3,
            specular=[0.15] * 3,
            castshadow=False,
        )
    visual = spec.visual
    visual.headlight.ambient, visual.headlight.diffuse, visual.headlight.specular = [0.42] * 3, [0.2] * 3, [0.05] * 3
    visual.quality.shadowsize, visual.quality.offsamples = 0, quality.samples
    visual.quality.numslices, visual.quality.numstacks = quality.slices, quality.slices * 7 // 12
    visual.global_.offwidth, visual.global_.offheight = width, height
    visual.map.haze, visual.rgba.haze = 0.6, [*_SKY, 1.0]
    # What the scene holds must not decide how it is lit or cut off: lengths are multiples of the extent.
    spec.stat.extent, spec.stat.center = 1.0, [0, 0, 0]
    visual.map.znear, visual.map.zfar = 0.05, _HORIZON
    visual.map.fogstart, visual.map.fogend, visual.rgba.fog = 0.2 * _HORIZON, 0.9 * _HORIZON, [*_SKY, 1.0]


def illuminate(scene: mujoco.MjvScene, azimuth: float) -> Float[np.ndarray, "3"]:
    """Light a frame from behind a camera that looks along `azimuth` [deg]; return where the sun shines to."""
    for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
        scene.flags[flag] = 0
    scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
    turn = np.radians(azimuth)
    ahead = np.array([np.cos(turn), np.sin(turn), 0.0])
    right = np.array([ahead[1], -ahead[0], 0.0])
    sun, fill = (light[0] * right + light[2] * ahead + [0.0, 0.0, light[1]] for light in (_SUN, _FILL))
    lights = [light for light in scene.lights[: scene.nlight] if not light.headlight]
    for light, aim in zip(lights, (sun, fill), strict=True):
        light.dir[:] = aim / np.linalg.norm(aim)
    return sun


def cast_shadows(scene: mujoco.MjvScene, sun: Float[np.ndarray, "3"]) -> None:
    """Let a frame cast shadows on the floor.

    A shadow is what casts it, flattened along the light. Shadow maps, the usual way, are ragged,
    speckle where they end, and take twice the time without a graphics card.
    """
    # Takes points along the light to the floor; a trace of their height is left, so that surfaces keep their order.
    flatten = np.eye(3) - np.outer(sun / sun[2], [0.0, 0.0, 1.0])
    flatten[2, 2] = _SHADOW_SLOPE
    for index in range(scene.ngeom):
        geom = scene.geoms[index]
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE or geom.rgba[3] < 1.0:
            continue
        shadow = scene.geoms[scene.ngeom]
        place, shape = flatten @ geom.pos + [0.0, 0.0, _SHADOW_HEIGHT], flatten @ geom.mat
        mujoco.mjv_initGeom(shadow, geom.type, np.ones(3), place, shape.ravel(), _SHADOW)
        shadow.size[:], shadow.dataid = geom.size, geom.dataid
        shadow.specular, shadow.emission = 0.0, _GLOW
        scene.ngeom += 1


def check_can_draw() -> None:
    """Raise `DrawingError` where this machine has no way to draw without a screen."""
    if trouble := _trouble():
        raise DrawingError(
            "This machine cannot draw without a screen. Install EGL (Debian: apt-get install libegl1 libgl1-mesa-dri) "
            "and set MUJOCO_GL=egl, or install OSMesa (libosmesa6) and set MUJOCO_GL=osmesa, before the program "
            f"starts. MuJoCo says: {trouble}"
        )


@cache
def _trouble() -> str:
    """Return why nothing can be drawn here; empty where it can.

    It is tried once: asked again after it has failed, MuJoCo ends the whole program.
    """
    try:
        with warnings.catch_warnings():
            # GLFW only warns that it found no screen; MuJoCo then fails, which is caught below.
            warnings.simplefilter("ignore")
            # Before MuJoCo 4, one that could not be made complains of these when it is forgotten.
            for name in ("_gl_context", "_mjr_context"):
                setattr(mujoco.Renderer, name, None)
            mujoco.Renderer(mujoco.MjSpec().compile(), 16, 16).close()
    except _CANNOT_DRAW as error:
        return str(error) or type(error).__name__
    return ""
