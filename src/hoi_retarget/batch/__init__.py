"""Many clips, robots and variants of them to a set of results, in one command that survives what happens at night."""
