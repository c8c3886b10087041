"""Help that fits a screen, and says what the whole help says."""

import re
import shlex

import pytest

from hoi_retarget.cli import main
from hoi_retarget.cli.commands import COMMANDS
from hoi_retarget.cli.program import parse
from hoi_retarget.cli.short_help import EXAMPLES, PURPOSES, groups_of, whole_help


def shown(capsys, *words: str) -> str:
    with pytest.raises(SystemExit) as ended:
        main(list(words))
    assert not ended.value.code
    return capsys.readouterr().out


@pytest.mark.parametrize("command", EXAMPLES)
def test_it_fits_a_screen_and_names_every_option_of_the_commands_own(command, capsys):
    text = shown(capsys, command, "--help")
    assert len(text.splitlines()) <= 40
    whole = whole_help(lambda: parse(COMMANDS[command], f"hoi-retarget {command}", ["--help"]))
    for option in groups_of(whole)["options"]:
        assert option.name.split(",")[0].split()[0] in text
        assert option.meaning, option.name
    for example in EXAMPLES[command]:
        assert example in text
        words = shlex.split(example.partition("#")[0])[1:]
        assert isinstance(parse(COMMANDS[command], "hoi-retarget", words), COMMANDS[command]), "it can be run"


def test_every_option_of_the_whole_help_is_found_in_a_group():
    whole = whole_help(lambda: parse(COMMANDS["run"], "hoi-retarget run", ["--help"]))
    named = set(re.findall(r"^  (--[a-z][^ ,]*)", whole, flags=re.MULTILINE))
    found = {option.name.split(",")[0].split()[0] for options in groups_of(whole).values() for option in options}
    assert named <= found and "--weights.jerk" in found


def test_the_whole_help_and_every_group_of_settings_can_be_had(capsys):
    assert "--weights.jerk" in shown(capsys, "run", "--help-all")
    assert main(["settings"]) == 0
    groups = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert {"weights", "solver", "physics"} <= set(groups)
    for group in groups:
        assert main(["settings", group]) == 0
        assert f"--{group}." in capsys.readouterr().out
    assert main(["settings", "nothing"]) == 2
    assert "no group 'nothing'" in capsys.readouterr().err


def test_the_programs_help_has_every_command_once(capsys):
    text = shown(capsys, "--help")
    assert sorted(name for names in PURPOSES.values() for name in names) == sorted(COMMANDS)
    for name in COMMANDS:
        assert len(re.findall(rf"^  {name} ", text, flags=re.MULTILINE)) == 1
