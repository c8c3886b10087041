"""The page that holds the paper against measured figures is what its script makes of the files with the figures."""

import importlib
import json
import re
from pathlib import Path

import pytest
import tyro

ROOT = Path(__file__).parents[1]
MEASURED = ROOT / "benchmarks" / "measured"


@pytest.fixture
def paper(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return importlib.import_module("paper"), importlib.import_module("paper_page")


def test_the_page_is_made_from_the_kept_figures(paper, tmp_path):
    script, _ = paper
    made, readme = tmp_path / "paper.md", tmp_path / "README.md"
    readme.write_text((ROOT / "README.md").read_text().replace("| 0", "| 7"))
    script.main(script.Arguments(measured=MEASURED, page=made, readme=readme))
    assert made.read_text() == (ROOT / "docs" / "paper.md").read_text()
    begin, end = script.MARKS
    tables = [file.read_text().partition(begin)[2].partition(end)[0] for file in (readme, ROOT / "README.md")]
    assert tables[0] == tables[1] != ""


def test_every_step_has_a_section_and_says_what_it_needs(paper):
    script, page = paper
    assert set(script.STEPS) == set(page.SECTIONS) == set(page.TITLES)
    nothing = script.Arguments(motions=Path("nowhere"))
    for name, step in script.STEPS.items():
        reason = script.left_out(name, nothing)
        assert bool(reason) == bool(step.needs) and all(f"--{need}" in reason for need in step.needs)
    text = page.page({}, dict.fromkeys(script.STEPS, "needs --data"))
    assert all(f"**{title}**: needs --data." in text for title in page.TITLES.values())
    headings = {line[3:].lower().replace(" ", "-") for line in text.splitlines() if line.startswith("## ")}
    assert set(re.findall(r"\]\(#([^)]+)\)", text)) <= headings


def test_every_step_calls_its_script_with_words_that_it_knows(paper, tmp_path):
    script, page = paper
    for folder in ("surface", "OmniRetarget labelled"):
        (tmp_path / folder).mkdir()
        for name in page.PERFORMED:
            (tmp_path / folder / f"{name}.npz").touch()
    there = dict.fromkeys(("data", "objects", "gmr", "gmr_script", "omniretarget", "motions"), tmp_path)
    arguments = script.Arguments(drawn=5, **there)
    for name, step in script.STEPS.items():
        file, *words = map(str, step.words(arguments))
        module = importlib.import_module(file.removesuffix(".py"))
        kept = tmp_path / f"{name}.json"
        assert tyro.cli(module.Arguments, args=[*words, "--json", str(kept)]).json == kept


def test_a_readme_without_marks_is_left_alone(paper, tmp_path):
    script, _ = paper
    (tmp_path / "README.md").write_text("no marks")
    with pytest.raises(SystemExit, match="nothing is written"):
        script.put_in(tmp_path / "README.md", "| table |")
    assert (tmp_path / "README.md").read_text() == "no marks"


def test_what_is_worse_than_another_program_comes_first(paper):
    _, page = paper
    found = json.loads((MEASURED / "peers.json").read_text())
    before = page.behind_peers(found)
    means = found["mean"]["contact_gap_m"]
    better = {**found["mean"], "contact_gap_m": {**means, "GMR": means["surface"] / 2}}
    told = page.behind_peers({**found, "mean": better})
    assert any("contact-point gap" in line and "GMR" in line for line in told)
    assert len(told) >= len(before)
    text = page.page({"peers": found}, {})
    assert text.index("## Where this project is behind") < text.index("## Claims") < text.index("## The benchmark")
