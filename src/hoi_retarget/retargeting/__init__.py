"""From a clip to a robot motion: targets, inverse kinematics, trajectory optimization."""
