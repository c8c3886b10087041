"""Human-object interaction recordings to humanoid robot motions."""

from importlib.metadata import version

__version__ = version("hoi-retarget")
