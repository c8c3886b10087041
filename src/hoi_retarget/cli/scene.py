"""`hoi-retarget scene`: a result as files that open in MuJoCo's own viewer."""

import sys

from hoi_retarget.cli.commands import Scene
from hoi_retarget.cli.jobs import check_inputs_kept, check_writable, load_motion
from hoi_retarget.cli.terminal import Working, say
from hoi_retarget.cli.weighed import clip_with_objects, physics_of
from hoi_retarget.files.atomic import write_together
from hoi_retarget.physics.scene import scene_of
from hoi_retarget.physics.scene_files import FILE, scene_files
from hoi_retarget.robots import load_robot


def execute(command: Scene) -> int:
    """Write the scene of a result; return 0."""
    check_writable("--out", command.out)
    motion = load_motion(command.result, command.robot)
    physics = physics_of(motion, command)
    with Working("making the scene", None):
        clip = clip_with_objects(motion, command)
        geometries = [] if clip is None else [track.geometry for track in clip.objects]
        scene = scene_of(motion, load_robot(motion.robot), geometries, physics)
        files = {command.out / place: content for place, content in scene_files(scene, motion).items()}
    check_inputs_kept("--out", files, [command.result])
    write_together(files)
    say(f"{command.out / FILE}  ({len(files)} files)")
    source = "published gains" if scene.actuators.published else "gains estimated from its torques: none are published"
    say(f"  robot   {scene.model.spec.title}, {source}")
    for item in scene.objects:
        say(f"  object  {item.body.name}: {item.body.mass:.2f} kg ({item.body.reason}), collides as {item.shape.text}")
    at_soles = f"{physics.floor_friction:g} at soles, {physics.object_friction:g} under objects"
    say(f"  friction {physics.hand_friction:g} at hands, {at_soles}")
    say(f"Open it: {sys.executable} -m mujoco.viewer --mjcf={command.out / FILE}   # keyframes: right panel, Physics")
    return 0
