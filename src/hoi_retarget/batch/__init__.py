"""Many clips, robots and variants of them to a set of results, in one command that survives what happens at night.

    specification = read_specification(Path("set.toml"))
    summary = run_batch(specification, Path("results"), LocalPool(do, workers=8, time_limit=600.0))

`specification` declares what is asked for and `jobs` lists it. `content` tells what is done already, `manifest` keeps
it. `pool` and `ray_pool` run jobs on this machine or on Ray, and know nothing of clips. `work` does one job and knows
nothing of processes. `run` puts them together.
"""

from hoi_retarget.batch.manifest import MANIFEST, Entry
from hoi_retarget.batch.pool import LocalPool, Lost, Pool
from hoi_retarget.batch.ray_pool import RayPool
from hoi_retarget.batch.run import Summary, run_batch
from hoi_retarget.batch.specification import Specification, of_folder, read_specification
from hoi_retarget.batch.work import do

__all__ = [
    "MANIFEST",
    "Entry",
    "LocalPool",
    "Lost",
    "Pool",
    "RayPool",
    "Specification",
    "Summary",
    "do",
    "of_folder",
    "read_specification",
    "run_batch",
]
