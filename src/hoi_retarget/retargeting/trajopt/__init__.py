"""Trajectory optimization over frames: cost terms, bounds, horizons and one banded solver."""
