"""Command line ``firnline``: its commands, in the order in which a survey uses them."""

import gc
import sys

import typer

from firnline.cli.commands import (
    calibrate,
    change,
    export,
    fit,
    init,
    localize,
    montecarlo,
    plan,
    reconstruct,
    report,
    reproduce,
    run,
    score,
    show,
    simulate,
)
from firnline.cli.desk import desk
from firnline.cli.guide import doctor, example, schema, topics
from firnline.cli.guide.examples_in_help import help_of
from firnline.cli.guide.version import options
from firnline.cli.live import download, rover, upload, watch
from firnline.cli.outcome import run_guarded
from firnline.cli.science import payload, rehearse, track

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
for command in (
    init.init,
    desk,
    plan.plan,
    upload.upload,
    download.download,
    watch.watch,
    rover.rover,
    simulate.simulate,
    calibrate.calibrate,
    localize.localize,
    reconstruct.reconstruct,
    payload.payload,
    score.score,
    change.change,
    track.track,
    report.report,
    run.run,
    montecarlo.montecarlo,
    rehearse.rehearse,
    fit.fit,
    reproduce.reproduce,
    export.export,
    show.show,
    doctor.doctor,
    example.example,
    schema.schema,
):
    app.command(help=help_of(command))(command)
app.command("examples", hidden=True)(example.example)
app.command("help", help=help_of(topics.help_))(topics.help_)


def main() -> None:
    """Run the command line; `firnline.cli.outcome` lists the exit codes."""
    gc.set_threshold(_ALLOCATIONS)
    run_guarded(lambda: app(args=sys.argv[1:]))


if __name__ == "__main__":
    main()
