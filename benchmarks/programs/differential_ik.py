"""CPU time of one differential IK solve by mink with daqp, without joint limits: the unit of `units.py`.

Runs in an environment with both.

    python differential_ik.py ROBOT.xml POSES.npz

`POSES.npz` holds names of bodies and their poses over time. Prints seconds a solve, the least of three runs.
"""

import sys
import time

import mink
import mujoco
import numpy as np


def main(robot: str, file: str) -> None:
    model = mujoco.MjModel.from_xml_path(robot)
    with np.load(file) as poses:
        names, positions, quats, qpos = (poses[name] for name in ("names", "positions", "quats", "qpos"))
    tasks = [mink.FrameTask(str(name), "body", position_cost=1.0, orientation_cost=1.0) for name in names]

    def run() -> float:
        configuration = mink.Configuration(model, q=qpos)
        seconds = 0.0
        for place, turn in zip(positions, quats, strict=True):
            targets = [
                mink.SE3.from_rotation_and_translation(mink.SO3(one), at) for one, at in zip(turn, place, strict=True)
            ]
            for task, target in zip(tasks, targets, strict=True):
                task.set_target(target)
            start = time.process_time()
            velocity = mink.solve_ik(configuration, tasks, 1.0 / 30.0, "daqp", damping=1e-3, limits=[])
            configuration.integrate_inplace(velocity, 1.0 / 30.0)
            seconds += time.process_time() - start
        return seconds / len(positions)

    print(min(run() for _ in range(3)))


if __name__ == "__main__":
    main(*sys.argv[1:])
