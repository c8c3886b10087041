"""Pages of the documentation site that lie outside `docs/`, and links to them: run by `mkdocs build`."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig  # pyright: ignore[reportMissingImports]
    from mkdocs.structure.files import Files  # pyright: ignore[reportMissingImports]

ROOT = Path(__file__).parents[1]
OUTSIDE = {
    "README.md": "index.md",
    "README.zh-CN.md": "zh.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "LICENSE": "license.md",
    "examples": "examples.md",
}
"""Files of the repository, and the pages that they become."""
PLAYABLE = {
    "images/viewer.png": "gallery/clips/carry_box-G1.html",
    "images/shared_page.png": "gallery/clips/carry_table-H2.html",
    "images/editor_after.png": "gallery/editor.html",
}
"""Pictures, and the pages of `make_gallery.py` that play what they show."""


def outside_pages() -> dict[str, str]:
    """Return the pages that are made of files outside `docs/`."""
    texts = {page: (ROOT / name).read_text() for name, page in OUTSIDE.items() if (ROOT / name).is_file()}
    programs = [f"## {path.stem}\n\n```python\n{path.read_text()}```\n" for path in sorted(ROOT.glob("examples/*.py"))]
    texts[OUTSIDE["LICENSE"]] = f"# Licence\n\n```text\n{texts[OUTSIDE['LICENSE']]}```\n"
    texts[OUTSIDE["examples"]] = "\n".join(["# Examples\n", *programs])
    return {page: on_page_markdown(text) for page, text in texts.items()}


def on_page_markdown(markdown: str, **_: object) -> str:
    """Return a page whose links lead to the site's pages, whose code blocks have a language alone, and which plays."""
    markdown = re.sub(r"^```(\w+) .*$", r"```\1", markdown, flags=re.MULTILINE)
    markdown = re.sub(r"(?<=\]\()[^)\s]+(?=\))", lambda link: relinked(link[0]), markdown)
    for picture, page in PLAYABLE.items():
        if (ROOT / "docs" / page).is_file():
            markdown = playable(markdown, picture, page)
    return markdown


def playable(markdown: str, picture: str, page: str) -> str:
    """Return a page with a playable page in the place of a picture, or behind one that stands in a table."""
    shown = rf"!\[([^\]]*)\]\({re.escape(picture)}\)"
    frame = rf'<iframe src="{page}" title="\1" loading="lazy" style="width:100%;height:34rem;border:0"></iframe>'
    markdown = re.sub(rf"^{shown}$", rf"{frame}\n\n[Open it alone]({page})", markdown, flags=re.MULTILINE)
    return re.sub(rf"(?<=\| )({shown})(?= \|)", rf"[\1]({page})", markdown)


def relinked(link: str) -> str:
    """Return where a link of a file of this repository leads on the site."""
    if "://" in link:
        return link
    path, hash_sign, anchor = link.removeprefix("../").removeprefix("docs/").partition("#")
    if path.startswith("examples/"):
        return f"{OUTSIDE['examples']}#{Path(path).stem}"
    return f"{OUTSIDE.get(path, path)}{hash_sign}{anchor}"


def on_files(files: "Files", config: "MkDocsConfig") -> "Files":
    """Add the pages of files outside `docs/`."""
    from mkdocs.structure.files import File  # noqa: PLC0415  # pyright: ignore[reportMissingImports]

    for page, text in outside_pages().items():
        files.append(File.generated(config, page, content=text))
    return files
