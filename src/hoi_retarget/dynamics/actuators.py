"""Gains and limits of a robot's joint drives.

A drive is a motor with a PD controller on the joint's angle. Its gains follow from the rotors' inertia as BeyondMimic
publishes them for the G1: a natural frequency of 10 Hz, twice critically damped.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import RobotError
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.model import RobotModel

_FREQUENCY = 2.0 * np.pi * 10.0  # [rad/s]
_DAMPING_RATIO = 2.0
_ARMATURE_PER_TORQUE = 1.44e-4  # Of the G1's motors of 25 N m [kg m^2 / (N m)]; its larger ones have 1.2e-4 and 1.8e-4.


@dataclass(frozen=True, eq=False)
class Actuators:
    """Drives of a robot's n hinges, in the model's order."""

    armature: Float[np.ndarray, "n"]  # Inertia of the rotors as the joints feel it [kg m^2].
    stiffness: Float[np.ndarray, "n"]  # [N m/rad]
    damping: Float[np.ndarray, "n"]  # [N m s/rad]
    torque: Float[np.ndarray, "n"]  # Largest torque [N m].
    published: bool  # Whether rotor inertias are published; otherwise they are estimated from the torques.


def actuators_of(model: RobotModel) -> Actuators:
    """Return a robot's drives; raises `RobotError` where a base carries it, or a joint's torque has no limit."""
    if model.spec.base != "legs":
        raise RobotError(
            f"{model.spec.name}: its base {model.spec.base}, and no drive, wheel or stand that carries it is known. "
            "Forces, scenes and simulations are for robots on legs; motions can be exported."
        )
    motors = [model.spec.motors.get(name) for name in model.joint_names]
    torque = np.array(
        [
            limit if motor is None or motor.torque is None else motor.torque
            for motor, limit in zip(motors, model.torque_limits, strict=True)
        ]
    )
    if (unlimited := ~np.isfinite(torque)).any():
        names = ", ".join(np.array(model.joint_names)[unlimited])
        raise RobotError(
            f"{model.spec.name}: no torque limit for {names}. Physics needs them: add actuatorfrcrange to the joints "
            f"of {model.spec.mjcf}, or add an added robot again with motor.JOINT in its --hints."
        )
    armature = np.array(
        [
            _ARMATURE_PER_TORQUE * limit if motor is None else motor.armature
            for motor, limit in zip(motors, torque, strict=True)
        ]
    )
    stiffness, damping = armature * _FREQUENCY**2, 2.0 * _DAMPING_RATIO * armature * _FREQUENCY
    for joint, motor in enumerate(motors):
        if motor is not None and motor.gains is not None:
            stiffness[joint], damping[joint] = motor.gains
    return Actuators(
        frozen(armature), frozen(stiffness), frozen(damping), frozen(torque), all(motor is not None for motor in motors)
    )
