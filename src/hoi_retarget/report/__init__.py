"""Many results on one page: how many are fit for use, which are not, and why."""
