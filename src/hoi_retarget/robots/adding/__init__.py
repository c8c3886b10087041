"""Any humanoid from its manufacturer's URDF or MJCF: its limbs are found by geometry, and a robot is made of them."""
