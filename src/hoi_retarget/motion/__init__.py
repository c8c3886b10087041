"""A robot's motion: its data, its result file, other programs' formats, and checks of them."""
