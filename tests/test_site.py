"""The documentation as a site: every page is in its navigation, and every link leads to a page or a file of it."""

import re
import subprocess
import sys
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from test_docs import anchors

ROOT = Path(__file__).parents[1]
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


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mkdocs") is None, reason="mkdocs-material, of the extra `docs`, is not installed")
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "index.html").is_file()
