"""Cost terms, one file each: a residual and its Jacobian for all frames at once."""
