"""Inner loops in C, each beside the same in numpy, which is used where this installation has no compiled library.

The library is built when the package is installed (`hatch_build.py`). It knows nothing of Python: arrays go to it as
addresses, so one build serves all of its versions.
"""
