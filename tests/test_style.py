"""How the code reads: one name for one module or class, no maze of small files, docstrings in the field's nouns."""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from hoi_retarget.cli.commands import COMMANDS

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "hoi_retarget"
FILES = sorted(PACKAGE.rglob("*.py"))
MODULES = [path for path in FILES if path.name not in {"__init__.py", "__main__.py"}]
# A cost term, a format, a reader, a robot's data and the options that help shows are files of their own, however short.
ALONE = ("retargeting/trajopt/terms", "motion/formats", "readers", "robots/unitree", "clip/read_options")
PRONOUNS = re.compile(
    r"\b(what(ever)?|whose|those (that|which|who|of which|in which|with which)|(that|this) which|the ones?( that)?"
    r"|how (far|many|much|long|often|large|deep|well|fast|wide|old|big|small|close|it|they|he|a|the|to|each|its))\b",
    flags=re.IGNORECASE,
)
"""Words that let a relative clause stand for a noun."""
UNITS = re.compile(
    r"\[(?:1|unitless|frames?|px|deg|Hz|(?:N )?m|rad|s|N|kg|J|W)\b[^\]]*\]|"
    r"\b(shares?|ratios?|factors?|(unit )?quaternions?|wxyz|unit (vectors?|ax[ei]s|length)|rotations?|units?)\b",
    flags=re.IGNORECASE,
)
"""Units of numbers, or words for numbers without one; `in their unit` and the like count."""

OTHER_TESTS = {
    "style": "of all sources of the package, here",
    "synthetic": "of the scenes that built-in clips are made of",
    "damage": "of every command on damaged files",
}
"""Names of tests that are of no one module, folder, command or document, with their subject."""


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def documented() -> list[tuple[str, ast.AST]]:
    """Return the place and the node of everything in the package that may have a docstring."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    return [
        (f"{name_of(path)}:{getattr(node, 'lineno', 1)}", node)
        for path in FILES
        for node in ast.walk(tree(path))
        if isinstance(node, kinds)
    ]


def test_every_file_and_class_name_stands_once():
    files = Counter(path.name for path in MODULES)
    classes = Counter(node.name for path in FILES for node in ast.walk(tree(path)) if isinstance(node, ast.ClassDef))
    assert [name for name, count in (files | classes).items() if count > 1] == []


def test_tests_are_named_after_their_subject():
    code = [path for folder in (PACKAGE, ROOT / "benchmarks", ROOT / "tools") for path in folder.rglob("*.py")]
    folders = [path.parent for path in code] + [ROOT / "examples", ROOT / "docs"]
    documents = [*(ROOT / "docs").glob("*.md"), ROOT / "README.md"]
    subjects = {path.stem.lower() for path in (*code, *folders, *documents)}
    subjects |= {command.replace("-", "_") for command in COMMANDS} | set(OTHER_TESTS)
    tests = [path.stem.removeprefix("test_") for path in (ROOT / "tests").glob("test_*.py")]
    assert sorted(set(tests) - subjects) == []
    assert set(OTHER_TESTS) <= set(tests)


def test_modules_are_more_than_a_page():
    short = [
        name_of(path)
        for path in MODULES
        if not name_of(path).startswith(ALONE) and len(path.read_text().splitlines()) < 60
    ]
    assert short == []
    assert len(FILES) <= 330


def test_docstrings_say_nouns_where_nouns_are_meant():
    found = []
    for place, node in documented():
        text = ast.get_docstring(node)  # pyright: ignore[reportArgumentType]  # one of the three kinds
        if text and (match := PRONOUNS.search(text.split("\n\n")[0])):
            found.append(f"{place}: {match.group(0)!r}")
    assert len(found) < 40, found


def test_public_functions_explain_five_arguments_and_more():
    explained, left = 0, []
    for place, node in documented():
        if not isinstance(node, ast.FunctionDef) or node.name.startswith("_"):
            continue
        given = [item.arg for item in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        if len(set(given) - {"self", "cls"}) >= 5:
            has = "Args:" in (ast.get_docstring(node) or "")
            explained += has
            left += [] if has else [f"{place}: {node.name}"]
    assert explained >= 9 * len(left), left


def test_public_functions_that_return_floats_say_their_units():
    said, left = 0, []
    for place, node in documented():
        if not isinstance(node, ast.FunctionDef) or node.name.startswith("_") or node.returns is None:
            continue
        if re.search(r"\b(float\b|Float\[)", ast.unparse(node.returns)):
            has = UNITS.search(ast.get_docstring(node) or "") is not None
            said += has
            left += [] if has else [f"{place}: {node.name}"]
    assert said >= 9 * len(left), left


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_every_ignore_has_its_reason(path):
    for number, line in enumerate(path.read_text().splitlines(), 1):
        ignore = re.search(r"# ?(noqa|type: ignore|pyright: ignore)\b.*", line)
        if ignore:
            assert re.search(r"(?:# | - )[\w`].*\w", ignore.group(0)[2:]), f"{name_of(path)}:{number}: {line.strip()}"
