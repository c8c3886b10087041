"""`hoi-retarget robots`: list, show and check."""

from hoi_retarget.cli.commands import Robots


def execute(command: Robots) -> int:
    """Do what is asked about robots."""
    raise NotImplementedError(command)
