"""Print the lowest versions that pyproject.toml allows, of what the fast tests need, as requirements for pip."""

import re
import tomllib
from pathlib import Path

GROUPS = ("dev",)
PLACE = Path(__file__).resolve().parents[1] / "pyproject.toml"


def lowest(requirements: list[str]) -> list[str]:
    """Return each requirement with the version that it names as its lowest; others as they are."""
    return [re.sub(r">=", "==", requirement) for requirement in requirements]


def main() -> None:
    """Print a requirement a line."""
    project = tomllib.loads(PLACE.read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *(item for name in GROUPS for item in project["optional-dependencies"][name])]
    print("\n".join(lowest(wanted)))


if __name__ == "__main__":
    main()
