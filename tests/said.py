"""What a command said on stderr."""

import re

_COMPLAINTS = re.compile(r"^(?!.*: (\d+ of \d+, )?\d+ s$).+\n", re.MULTILINE)


def complaints_in(said: str) -> str:
    """Return what was said on stderr but for the progress of a busy machine."""
    return "".join(match[0] for match in _COMPLAINTS.finditer(said))
