"""Many clips, robots and variants of them to a set of results, in one command that survives what happens at night.

    specification = read_specification(Path("set.toml"))
    summary = run_batch(specification, Path("results"), LocalPool(do, workers=8, time_limit=600.0))

`specification` declares what is asked for and `jobs` lists it. `content` tells what is done already, `manifest` keeps
it. `pool` and `ray_pool` run jobs on this machine or on Ray, and know nothing of clips. `work` does one job and knows
nothing of processes. `run` puts them together.

Nothing is imported here, so that a worker imports only what it needs.
"""
