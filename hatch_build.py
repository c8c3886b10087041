"""Build hook: compiles `src/hoi_retarget/kernels/*.c` with the machine's C compiler, or with that of `ziglang`."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = Path(__file__).parent / "src" / "hoi_retarget" / "kernels"
# Products are rounded before they are summed: the same figures by every compiler.
FLAGS = ["-O3", "-ffp-contract=off", "-shared", "-fvisibility=hidden"]


class KernelsHook(BuildHookInterface):
    """Adds the compiled library to the package."""

    def dependencies(self) -> list[str]:
        """Return the compiler, where the machine has none."""
        return [] if _own_compiler() else ["ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; the wheel is then one of this platform."""
        compiler = _own_compiler() or [sys.executable, "-m", "ziglang", "cc"]
        name = {"win32": "kernels.dll", "darwin": "kernels.dylib"}.get(sys.platform, "kernels.so")
        made = FOLDER / f"{name}.new"
        libraries = [] if sys.platform == "win32" else ["-fPIC", "-lm"]
        sources = sorted(map(str, FOLDER.glob("*.c")))
        subprocess.run([*compiler, *FLAGS, "-o", str(made), *sources, *libraries], check=True)
        made.replace(FOLDER / name)
        build_data["artifacts"].append(f"src/hoi_retarget/kernels/{name}")
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"], build_data["pure_python"] = f"py3-none-{platform}", False


def _own_compiler() -> list[str] | None:
    named = os.environ.get("CC")
    found = named or next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
    return found.split() if found else None
