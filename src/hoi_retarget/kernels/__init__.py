"""Inner loops in C.

The library is built when the package is installed (`hatch_build.py`). It knows nothing of Python: arrays go to it as
addresses, so one build serves all of its versions.
"""
