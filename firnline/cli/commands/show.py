"""``firnline show``: show the stages and results of a run."""

from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.facts import fact_line
from firnline.cli.options import Json
from firnline.cli.outcome import with_exit_codes


@with_exit_codes
def show(
    run: Annotated[
        Path, typer.Argument(help="A run folder, a mission's folder of runs, or its latest link.")
    ],
    as_json: Json = False,
) -> None:
    """Show which stages of a run are done, how long they took, and the score.

    Every file is checked against the checksum that was taken when it was written.

    For example:

      firnline show results/runs/srtm-ridge
    """
    from firnline.cli.mission_file import print_summary
    from survey.core.documents import read_log
    from survey.core.run_folder import STAGES, RunFolder

    folder = RunFolder.find(run)
    done = [stage for stage in STAGES if folder.has(stage)]
    for stage in done:
        folder.verify(stage)
    if folder.log_file.exists():
        read_log(folder.log_file)
    if not as_json:
        missing = [stage for stage in STAGES if stage not in done]
        left = f"; open: {', '.join(missing)}" if missing else ""
        typer.echo(fact_line("done", f"{', '.join(done) or 'nothing'}{left}"))
    print_summary(folder, as_json=as_json)
