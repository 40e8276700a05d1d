"""Reference of the command line: one page for each command, from the commands themselves."""

import re
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import typer

from firnline.cli.main import app
from generate.tables import block, code, table, toctree


def pages() -> dict[str, str]:
    """Return a page for each command, and a list of them."""
    found = commands()
    texts = {f"reference/commands/{name}.md": command_page(name, command) for name, command in found.items()}
    rows = [(f"[`firnline {name}`]({name}.md)", summary(command)) for name, command in found.items()]
    texts["reference/commands/index.md"] = (
        "# Command line\n\n"
        "`firnline COMMAND --help` prints the same texts. Data go to standard output, messages to standard error; "
        "[exit codes](../exit-codes.md) state how a command ended.\n\n"
        + table(("command", "purpose"), rows)
        + "\n"
        + toctree(found)
    )
    return texts


def commands() -> dict[str, Any]:
    """Return the commands by name, in the order of ``firnline --help``."""
    group: Any = typer.main.get_command(app)
    return dict(group.commands)


def summary(command: Any) -> str:
    """Return the first sentence of a command's help."""
    return str(command.help).strip().split("\n\n")[0]


def command_page(name: str, command: Any) -> str:
    """Return the page of a command: description, examples, arguments and options."""
    # The mark that keeps an example on one line on a terminal.
    text, _, examples = str(command.help).replace("\b", "").partition("For example:")
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.param_type_name == "option"]
    words = [argument_word(argument) for argument in arguments]
    parts = [
        f"# firnline {name}\n",
        plain(text) + "\n",
        block(" ".join(["firnline", name, *words, "[OPTIONS]"])),
    ]
    if examples:
        lines = [" ".join(line.split()) for line in examples.split("\n\n") if line.strip()]
        parts += ["## Examples\n", block("\n".join(lines), "shell")]
    if arguments:
        rows = [(code(argument_word(a)), plain(a.help or "")) for a in arguments]
        parts += ["## Arguments\n", table(("argument", "meaning"), rows)]
    hints = get_type_hints(command.callback, include_extras=True)
    rows = [option_row(option, hints[option.name]) for option in options]
    rows.append((code("-h, --help"), "", "Show the help and exit."))
    parts += ["## Options\n", table(("option", "default", "meaning"), rows)]
    return "\n".join(parts)


def argument_word(argument: Any) -> str:
    """Return an argument as usage lines show it."""
    word = argument.name.upper() + ("..." if argument.nargs == -1 else "")
    return word if argument.required else f"[{word}]"


def option_row(option: Any, annotation: Any) -> tuple[str, str, str]:
    """Return an option's spellings, default and meaning."""
    spellings = ", ".join(sorted((*option.opts, *option.secondary_opts), key=len))
    value = "" if option.is_flag else f" {option.metavar or kind(annotation)}"
    help_text = option.help or ""
    stated = re.search(r"\s*\[default: (.*?)\]\s*$", help_text)
    default = (
        stated[1]
        if stated
        else ""
        if option.default in (None, False, ()) or callable(option.default)
        else str(option.default)
    )
    return code(spellings + value), code(default), plain(help_text[: stated.start()] if stated else help_text)


def kind(annotation: Any) -> str:
    """Return the type of an option's value in capitals, or its choices."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return "|".join(map(str, arguments))
    if origin in (Annotated, list):
        return kind(arguments[0])
    if origin in (Union, UnionType):
        return next(kind(part) for part in arguments if part is not NoneType)
    return {Path: "PATH", str: "TEXT", int: "INTEGER", float: "NUMBER"}.get(annotation, "VALUE")


def plain(text: str) -> str:
    """Return a help text as Markdown: paragraphs without line breaks, no accidental markup."""
    paragraphs = [" ".join(part.split()) for part in text.replace("\b", "").split("\n\n")]
    return "\n\n".join(
        re.sub(r"(?<!`)(--[\w-]+)(?!`)", r"`\1`", part).replace("*", "\\*") for part in paragraphs if part
    )
