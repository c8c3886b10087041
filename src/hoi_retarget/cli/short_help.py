"""Help that fits a screen: first sentences of a command's own options, examples, and groups of settings by name.

It is read from the whole help, which `--help-all` prints, so that both say the same.
"""

import io
import re
import textwrap
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass

PURPOSES: Mapping[str, tuple[str, ...]] = {
    "retarget": ("demo", "run", "batch", "sample", "robots"),
    "look": ("view", "render", "share"),
    "check and correct": ("inspect", "evaluate", "report", "edit", "contacts", "check-motion"),
    "train": ("export", "feasible", "refine", "scene"),
    "other": ("convert", "settings", "doctor"),
}
"""Commands by what they are for."""
EXAMPLES = {
    "run": (
        "run CLIP.pt --objects DIR --out results                        # a recording, to the G1",
        "run builtin:carry_table --robot g1,h2 --out results            # two people, two robots",
        "run CLIP.pt --edits CLIP.edits.toml --weights.jerk 2 --out new # with corrected contacts",
    ),
    "edit": ("edit CLIP.pt --objects DIR", "edit builtin:carry_box --robot h2"),
    "batch": ("batch recordings --objects DIR --out results", "batch jobs.toml --out results --workers 8"),
}
"""Of the commands with a short help: the whole help of the others fits a screen or two."""
_WIDTH, _NAME = 100, 31
_OWN = ("positional arguments", "options")  # Groups of a command's own.


@dataclass(frozen=True)
class Option:
    """One option, or one positional argument."""

    name: str
    meaning: str

    @property
    def first_sentence(self) -> str:
        """Of its meaning."""
        return re.split(r"(?<=[.;]) (?=\S)|: | \(default", self.meaning, maxsplit=1)[0].rstrip(".;:")


def whole_help(parse: Callable[[], object]) -> str:
    """Return the text of a parser's `--help`, without colours."""
    with redirect_stdout(io.StringIO()) as printed, suppress(SystemExit):
        parse()
    return re.sub(r"\x1b\[[0-9;]*m", "", printed.getvalue())


def groups_of(text: str) -> Mapping[str, tuple[Option, ...]]:
    """Return the options of a whole help by the title of their group."""
    groups: dict[str, list[list[str]]] = {}
    title, lines = "", text.splitlines()
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if re.fullmatch(r" \S.*", line) and re.fullmatch(r" -+\s*", below):
            title = line.strip().removesuffix(" options")
            groups[title] = []
        elif title and re.match(r"  (--[a-z]|[A-Z])\S*( |$)", line) and (title in _OWN or "--" in line):
            groups[title].append([line.strip()])
        elif title and groups[title] and line.startswith(" " * 8):
            groups[title][-1].append(line.strip())
    return {name: tuple(map(_option, entries)) for name, entries in groups.items()}


def _option(lines: list[str]) -> Option:
    name, _, meaning = lines[0].partition("  ")
    return Option(name, " ".join([meaning.strip(), *lines[1:]]).strip())


def short_help(text: str, command: str) -> str:
    """Return the short form of a command's whole help."""
    groups = groups_of(text)
    usage, _, rest = text.strip().partition("\n\n")
    lines = [usage, "", *textwrap.wrap(" ".join(rest.partition("\n\n")[0].split()), _WIDTH), ""]
    for option in (option for name in _OWN for option in groups.get(name, ())):
        name = option.name.partition(", --")[0]
        lines += _row(name, option.first_sentence)
    settings = [name for name in groups if name not in _OWN]
    if settings:
        lines += ["", f"Settings (hoi-retarget settings GROUP): {', '.join(settings)}"]
    lines += ["", *(f"  hoi-retarget {example}" for example in EXAMPLES.get(command, ()))]
    lines.append(f"All of it: hoi-retarget {command} --help-all")
    return "\n".join(lines)


def commands_text(description: str, meanings: Mapping[str, str]) -> str:
    """Return the program's help: its commands by purpose, each with a first sentence."""
    lines = [*textwrap.wrap(description, _WIDTH), "", "usage: hoi-retarget COMMAND [OPTIONS] ..."]
    for purpose, names in PURPOSES.items():
        lines += ["", f"{purpose}:"]
        for name in names:
            lines += _row(name, Option(name, " ".join(meanings[name].split())).first_sentence)
    return "\n".join([*lines, "", "hoi-retarget COMMAND --help tells more; --version tells the version."])


def settings_text(text: str, group: str | None) -> str:
    """Return the settings of a group, or the groups there are; raises `KeyError` for another name."""
    groups = {name: options for name, options in groups_of(text).items() if name not in _OWN}
    if group is None:
        rows = [_row(name, f"{len(options)} settings") for name, options in groups.items()]
    else:
        rows = [_row(option.name, option.meaning) for option in groups[group]]
    return "\n".join(line for row in rows for line in row)


def _row(name: str, meaning: str) -> list[str]:
    lines = textwrap.wrap(meaning, _WIDTH - _NAME - 2) or [""]
    first = [f"  {name:<{_NAME - 2}}{lines[0]}"] if len(name) < _NAME - 2 else [f"  {name}", f"{'':{_NAME}}{lines[0]}"]
    return [*first, *(f"{'':{_NAME}}{line}" for line in lines[1:])]
