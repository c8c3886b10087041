"""Resumable batches: many clips, robots and variants to a set of results in one command.

    specification = read_specification(Path("set.toml"))
    summary = run_batch(specification, Path("results"), LocalPool(run_job, workers=8, time_limit=600.0))

`specification` declares a batch, `jobs` lists its jobs. `content` digests the inputs of a job, `manifest` keeps its
outcome: both together tell which jobs are left. `pool` and `ray_pool` run tasks on this machine or on Ray, and know
nothing of clips. `work` runs one job and knows nothing of processes. `run` puts them together.

Nothing is imported here, so that a worker imports only what it needs.
"""
