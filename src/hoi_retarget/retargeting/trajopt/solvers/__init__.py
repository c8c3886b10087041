"""Solvers of the optimization problem, one file each behind the interface in `base`."""
