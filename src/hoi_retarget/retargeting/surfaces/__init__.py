"""Contact between surfaces: the robot's skin touches an object where it is to, and nothing is inside anything."""
