"""Arrays, rotations and filters."""
