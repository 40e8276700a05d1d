"""Stages of a mission for the commands that take a mission file, with their progress."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from firnline.actions.requests import RunOptions
from firnline.cli.request import Printing, print_result


def run_stages(
    mission_file: Path, options: RunOptions, until: str, printing: Printing, *, workers: int | None = None
) -> None:
    """Run the stages of a mission up to one and print its summary, or print which stages would be done."""
    from firnline.actions.missions import preview_stages, run_until

    if printing.dry_run:
        print_result(preview_stages(mission_file, options, until=until))
        return
    made = run_until(
        mission_file,
        until,
        options,
        workers=workers,
        watch=watched_by(printing),
        verbose=printing.verbose,
    )
    print_result(replace(made, wanted=None), as_json=printing.as_json)


def watched_by(
    printing: Printing,
) -> Callable[[Mapping[str, float]], Callable[[str], AbstractContextManager[None]]]:
    """Return what shows the progress of stages, given the seconds that they took before."""
    from firnline.cli.progress import StageProgress

    return lambda expected_s: StageProgress(quiet=printing.quiet, expected_s=expected_s)
