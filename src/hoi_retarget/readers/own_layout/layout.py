"""What the layout is called and what never varies in it."""

FORMAT = "hoi-retarget-clip"
SCHEMA = 1
SCHEMA_KEY = "clip_schema"
UP, UNIT = "z", "m"
HEIGHTS = "person_heights"
DOCUMENT = "docs/sources.md describes the layout."

CLIP_FILE = "clip.npz"
"""What the clip in a folder is called."""
LARGEST_VALUE = 1e4
"""Of any number; metres, radians, frames a second and quaternions stay below."""

# Kinds of numpy arrays by what they mean.
NUMBERS, INTEGERS, TEXT, FLAGS = "fiu", "iu", "U", "b"
