"""Runs OmniRetarget on one clip in InterMimic's layout: by the Python of its own environment, not by this project's.

    pip install holosoma-retargeting==0.1.0 mujoco==3.11.0     (later ones of MuJoCo break it without a word)
    PYTHON omniretarget.py CLIP.pt OBJECTS OUT.npz

Its wiring knows one object, the large box. Here every object gets what that one has: a mesh, a URDF and a scene.
Prints CPU seconds of the run without start-up as JSON.
"""

import json
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

import holosoma_retargeting

PACKAGE = Path(holosoma_retargeting.__path__[0])
SCENE = "g1_29dof_w_{}.xml"
KNOWN = "largebox"


def folder_for(name: str, mesh: Path, into: Path) -> None:
    """Lay out what the program looks for below its working folder, for an object of some name."""
    robot, thing = into / "models" / "g1", into / "models" / name
    robot.mkdir(parents=True)
    thing.mkdir()
    for item in (PACKAGE / "models" / "g1").iterdir():
        (robot / item.name).symlink_to(item)
    (into / "demo_data").symlink_to(PACKAGE / "demo_data")
    (thing / f"{name}.obj").symlink_to(mesh.resolve())
    urdf = (PACKAGE / "models" / KNOWN / f"{KNOWN}.urdf").read_text()
    (thing / f"{name}.urdf").write_text(urdf.replace(KNOWN, name))
    scene = (PACKAGE / "models" / "g1" / SCENE.format(KNOWN)).read_text().replace(KNOWN, name)
    # MuJoCo follows links before it goes up from a scene to the object's folder.
    scene = scene.replace(f"../../{name}/{name}.obj", str(thing / f"{name}.obj"))
    own = robot / SCENE.format(name)
    own.unlink(missing_ok=True)
    own.write_text(scene)


def main(clip: Path, objects: Path, out: Path) -> None:
    """Run the program in a folder of its own, and keep its result."""
    from holosoma_retargeting.config_types.retargeting import RetargetingConfig
    from holosoma_retargeting.config_types.task import TaskConfig
    from holosoma_retargeting.examples import robot_retarget

    name = clip.stem.split("_")[1]
    mesh = next(
        objects / name / f"{name}{kind}.obj"
        for kind in ("", "_hull")
        if (objects / name / f"{name}{kind}.obj").exists()
    )
    with tempfile.TemporaryDirectory() as folder:
        folder_for(name, mesh, Path(folder))
        os.chdir(folder)
        config = RetargetingConfig(
            task_type="object_interaction",
            task_name=clip.stem,
            data_format="smplh",
            data_path=clip.parent,
            save_dir=Path(folder) / "out",
            task_config=TaskConfig(object_name=name),
        )
        start = time.process_time()
        robot_retarget.main(config)
        used = time.process_time() - start
        shutil.move(Path(folder) / "out" / f"{clip.stem}_original.npz", out)
    print(json.dumps({"cpu_seconds": used}))


if __name__ == "__main__":
    main(*(Path(argument).resolve() for argument in sys.argv[1:4]))
