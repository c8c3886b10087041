"""One thread for linear algebra, as pytest-xdist fills the cores; and the same examples in every run."""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import pytest  # noqa: E402 - after the variables, which numpy reads when it is imported
from hypothesis import settings  # noqa: E402 - as above

# A test that fails on one run of many is a fault that nobody can look into.
settings.register_profile("repeatable", derandomize=True, database=None)
settings.load_profile("repeatable")


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch):
    """Keep what a busy machine takes long for from saying so, where tests read what is said."""
    monkeypatch.setattr("hoi_retarget.cli.terminal.PAUSE_S", 3600.0)


@pytest.fixture(autouse=True)
def no_robots_of_the_user(monkeypatch, tmp_path):
    """Keep robots and meshes that the user of this machine has from changing what tests see."""
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "no robots"))
