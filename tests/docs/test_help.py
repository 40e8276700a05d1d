"""Help of the commands: every example is accepted by the parser of its command."""

import re
import shlex

import pytest
import typer

from firnline.cli.main import app

COMMANDS = typer.main.get_command(app).commands
EXAMPLES = sorted(
    {
        example
        for command in COMMANDS.values()
        for example in re.findall(r"^\s*(firnline .*)$", command.help or "", flags=re.MULTILINE)
    }
)


@pytest.mark.parametrize("example", EXAMPLES)
def test_an_example_is_accepted_by_its_command(example):
    _, name, *words = shlex.split(example.split(" > ")[0])
    context = COMMANDS[name].make_context(name, words)
    assert context.command.name


def test_every_command_has_an_example():
    bare = {name for name, command in COMMANDS.items() if "firnline " not in (command.help or "")}
    assert not bare
