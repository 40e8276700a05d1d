"""Command line ``firnline``: its commands, in the order in which a survey uses them."""

import gc
import sys

import typer

from firnline.cli import guide, mapping, missions, planning, scoring, vehicles
from firnline.cli.outcome import run_guarded
from firnline.cli.request import SurveyStep, help_of, options

# Allocations between two searches for reference cycles; at Python's 700 they take a tenth of the time of a report.
_ALLOCATIONS = 50_000

app = typer.Typer(
    name="firnline",
    help="Plan, simulate and judge robotic surveys of glaciers and other terrain.",
    epilog="Start with: firnline init my-survey.toml, then firnline run my-survey.toml.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
)

app.callback()(options)
for step in SurveyStep:
    for module in (planning, vehicles, mapping, scoring, missions, guide):
        for command in module.COMMANDS.get(step, ()):
            app.command(help=help_of(command))(command)
app.command("examples", hidden=True)(guide.example)
app.command("help", help=help_of(guide.help_))(guide.help_)


def main() -> None:
    """Run the command line; `firnline.cli.outcome` lists the exit codes."""
    gc.set_threshold(_ALLOCATIONS)
    run_guarded(lambda: app(args=sys.argv[1:]))


if __name__ == "__main__":
    main()
