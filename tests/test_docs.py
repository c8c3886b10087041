"""What the documents name is there: imports, modules, files, links, options, and pages of the site."""

import ast
import io
import re
import subprocess
import sys
import tomllib
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from importlib import import_module
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from hoi_retarget.cli.commands import COMMANDS
from hoi_retarget.cli.program import run

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "hoi_retarget"
DOCUMENTS = {
    path.name: path
    for path in (
        ROOT / "README.md",
        ROOT / "README.zh-CN.md",
        ROOT / "CONTRIBUTING.md",
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")),
    )
}
TEXTS = {name: path.read_text() for name, path in DOCUMENTS.items()}
OF_OTHERS = {"simulation/interact2mimic.py"}
"""Files that are part of other projects."""
OPTIONS_OF_OTHERS = {"--input_fps", "--json", "--data", "--clip", "--help"}
"""Options of other programs and of the benchmarks' scripts."""

every_document = pytest.mark.parametrize("name", DOCUMENTS)


def exists(module: str, name: str) -> bool:
    """Return whether a module has an attribute or a submodule of that name; raises `ImportError` without the module."""
    if hasattr(import_module(module), name):
        return True
    try:
        import_module(f"{module}.{name}")
    except ModuleNotFoundError:
        return False
    return True


# Python


@every_document
def test_python_blocks_compile_and_their_imports_work(name):
    for block in re.findall(r"^```python\n(.*?)^```", TEXTS[name], flags=re.MULTILINE | re.DOTALL):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    import_module(alias.name)
            elif isinstance(node, ast.ImportFrom):
                assert node.module is not None
                missing = [alias.name for alias in node.names if not exists(node.module, alias.name)]
                assert not missing, f"{node.module} has no {', '.join(missing)}"
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "hr":
                assert exists("hoi_retarget", node.attr), f"hoi_retarget has no {node.attr}"


@every_document
def test_full_names_of_the_package_exist(name):
    for full in re.findall(r"`(hoi_retarget(?:\.\w+)+)", TEXTS[name]):
        module, _, attribute = full.rpartition(".")
        assert exists(module, attribute), full


# Files


@every_document
def test_files_and_folders_of_the_code_exist(name):
    folders = (ROOT, PACKAGE, ROOT / "benchmarks")
    for path in re.findall(r"`([\w./-]+\.(?:py|js|j2))`", TEXTS[name]):
        assert path in OF_OTHERS or any((folder / path).is_file() for folder in folders), path
    for path in re.findall(r"`((?:[a-z_]+/)+)`", TEXTS[name]):
        assert any((folder / path).is_dir() for folder in folders), path
    for script in re.findall(r"python ([\w./-]+\.py)", TEXTS[name]):
        assert (ROOT / script).is_file() or "/" not in script, script


# Links


def anchors(text: str) -> set[str]:
    """Return the anchors of a document's headings, as GitHub makes them."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.+)$", prose, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@every_document
def test_relative_links_and_their_anchors_resolve(name):
    for link in re.findall(r"\]\(([^)\s]+)\)", TEXTS[name]):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = DOCUMENTS[name].parent / path if path else DOCUMENTS[name]
        assert target.exists(), link
        assert not anchor or anchor in anchors(target.read_text()), link


# Dependencies


def test_the_design_page_has_a_line_for_each_dependency_and_no_other():
    document = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project, build = document["project"], document["build-system"]["requires"]
    (table,) = re.findall(r"## Dependencies\n\n.*?\n\|---\|---\|\n(.*?)\n\n", TEXTS["design.md"], flags=re.DOTALL)
    rows = [row.split("|")[1].strip() for row in table.splitlines()]
    core = [row for row in rows if not row.startswith("*")]
    assert sorted(core) == sorted(map(package, project["dependencies"]))
    listed = {name for row in rows if row.startswith("*") for name in row.partition(": ")[2].split(", ")}
    extras = {package(line) for lines in project["optional-dependencies"].values() for line in lines}
    # Where a machine has no compiler, the build asks for one.
    assert listed == extras | set(build) | {"ziglang"}


def package(requirement: str) -> str:
    return re.split(r"[\[>=<]", requirement)[0]


# The command line


@cache
def options_of(command: str) -> frozenset[str]:
    """Return the options in a command's help; of all its actions, where it has some."""
    texts = [help_of(command)]
    if command == "robots":
        texts += [help_of(command, action) for action in ("add", "list", "show", "check")]
    return frozenset(re.findall(r"--[a-z][\w.-]*", " ".join(texts)))


def help_of(*words: str) -> str:
    output = io.StringIO()
    with redirect_stdout(output), redirect_stderr(output), pytest.raises(SystemExit):
        run([*words, "--help-all" if words and words[0] in COMMANDS and "robots" not in words else "--help"])
    return output.getvalue()


@every_document
def test_commands_and_their_options_exist(name):
    for command, rest in re.findall(r"hoi-retarget ([a-z][a-z-]+)\b([^`\n|]*)", TEXTS[name]):
        if command not in COMMANDS:
            assert not rest.strip().startswith("--"), f"there is no command {command!r}"
            continue
        for option in re.findall(r"(?<!\S)(--[a-z][\w.-]*)", rest.partition(" # ")[0]):
            assert option in options_of(command), f"{command} has no {option}"


@every_document
def test_options_that_are_named_alone_exist(name):
    known = frozenset.union(*map(options_of, COMMANDS)) | OPTIONS_OF_OTHERS
    for words in re.findall(r"`(--[a-z][^`\n]*)`", TEXTS[name]):
        for option in re.findall(r"(?<!\S)--[a-z][\w.-]*", words):
            assert option in known, option


SPEC = spec_from_file_location("site_hooks", ROOT / "docs" / "site_hooks.py")
assert SPEC is not None and SPEC.loader is not None
HOOKS = module_from_spec(SPEC)
SPEC.loader.exec_module(HOOKS)
PAGES = {path.name: HOOKS.on_page_markdown(path.read_text()) for path in (ROOT / "docs").glob("*.md")}
OUTSIDE = HOOKS.outside_pages()
NAVIGATION = re.findall(r"^ +- .+: (\S+\.md)$|^  - .+: (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE)


def test_the_navigation_has_every_page_once() -> None:
    assert not PAGES.keys() & OUTSIDE.keys()
    assert sorted("".join(names) for names in NAVIGATION) == sorted([*PAGES, *OUTSIDE])


@pytest.mark.parametrize("page", sorted([*PAGES, *OUTSIDE]))
def test_links_of_a_page_lead_to_pages_and_files_of_the_site(page: str) -> None:
    pages = {**PAGES, **OUTSIDE}
    for link in re.findall(r"\]\(([^)\s]+)\)", pages[page]):
        name, _, anchor = link.partition("#")
        if "://" in name:
            continue
        assert name in pages or not name or (ROOT / "docs" / name).is_file(), link
        assert not anchor or anchor in anchors(pages[name or page]), link


@pytest.mark.parametrize(
    ("link", "where"),
    [
        ("docs/robots.md#from-the-makers-file", "robots.md#from-the-makers-file"),
        ("../examples/06_write_your_own_clip.py", "examples.md#06_write_your_own_clip"),
        ("README.md#measured", "index.md#measured"),
        ("docs/images/film.webp", "images/film.webp"),
        ("#start", "#start"),
        ("https://example.org/docs/a.md", "https://example.org/docs/a.md"),
    ],
)
def test_links_of_the_repository_become_links_of_the_site(link: str, where: str) -> None:
    assert HOOKS.relinked(link) == where


def test_pictures_become_pages_that_play_where_these_were_made(tmp_path: Path, monkeypatch) -> None:
    (picture, page), *_ = HOOKS.PLAYABLE.items()
    alone, in_a_table = f"before\n\n![A view]({picture})\n\nafter", f"| ![A view]({picture}) | text |"
    monkeypatch.setattr(HOOKS, "ROOT", tmp_path)
    assert HOOKS.on_page_markdown(alone) == alone
    made = tmp_path / "docs" / page
    made.parent.mkdir(parents=True)
    made.touch()
    shown = HOOKS.on_page_markdown(alone)
    assert f'<iframe src="{page}" title="A view"' in shown and f"]({page})" in shown and picture not in shown
    assert HOOKS.on_page_markdown(in_a_table) == f"| [![A view]({picture})]({page}) | text |"
    assert all((ROOT / "docs" / each).is_file() for each in HOOKS.PLAYABLE)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mkdocs") is None, reason="mkdocs-material, of the extra `docs`, is not installed")
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "index.html").is_file()
