"""HTML from Jinja2 templates, which lie beside the code that fills them.

Every value is escaped unless a template says `safe`, and a value that is missing is an error.
"""

import base64
import gzip
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from hoi_retarget import __version__

if TYPE_CHECKING:
    import jinja2


def render(template: str, **values: Any) -> str:
    """Return a template, named by its path inside the package with forward slashes, filled with values."""
    return _environment().get_template(template).render(values)


def asset(path: str) -> str:
    """Return the text of a file inside the package."""
    return (files("hoi_retarget") / path).read_text(encoding="utf-8")


def assets(paths: str | Sequence[str]) -> str:
    """Return the text of a file inside the package, or of several one after the other."""
    return "\n".join(map(asset, [paths] if isinstance(paths, str) else paths))


def csp_hash(script: str) -> str:
    """Return a script's digest as a content security policy names it."""
    return f"sha256-{base64.b64encode(sha256(script.encode()).digest()).decode('ascii')}"


def packed(text: str) -> str:
    """Return a text as base64 of gzip."""
    return base64.b64encode(gzip.compress(text.encode(errors="replace"), compresslevel=6, mtime=0)).decode("ascii")


def with_exponents(text: str) -> str:
    """Return a unit, or a sentence with units, with raised exponents."""
    return text.replace("^3", "³")


@cache
def _environment() -> "jinja2.Environment":
    import jinja2  # noqa: PLC0415 - commands without pages start without it

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(asset),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"csp_hash": csp_hash, "packed": packed, "with_exponents": with_exponents}
    environment.globals |= {"asset": asset, "assets": assets, "version": __version__}
    return environment
