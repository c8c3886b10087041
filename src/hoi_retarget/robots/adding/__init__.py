"""Any humanoid from its maker's URDF or MJCF: its limbs are found by geometry, and a robot is made of them."""
