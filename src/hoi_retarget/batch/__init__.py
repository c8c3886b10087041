"""Resumable batches: many clips, robots and variants to a set of results in one command.

    specification = read_specification(Path("set.toml"))
    summary = run_batch(specification, Path("results"), LocalPool(run_job, workers=8, time_limit=600.0))

`specification` declares a batch, `jobs` lists its jobs and digests their inputs, `manifest` stores their outcomes: both
together give the jobs left. `pool` runs tasks in processes of this machine, and knows nothing of clips.
`work` runs one job and knows nothing of processes. `run_batch` puts them together.

Nothing is imported here, so that a worker imports only what it needs.
"""
