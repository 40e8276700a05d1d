"""MCAP files for ``firnline export``."""

from pathlib import Path

import typer

from sim.cli.live.options import needs_live_extra


def export_mcap(source: Path, out: Path) -> None:
    """Write the MCAP file of a run.

    Parameters
    ----------
    source : pathlib.Path
        Run folder.
    out : pathlib.Path
        Ends in ``.mcap``.
    """
    from survey.core.runs.store import RunFolder

    with needs_live_extra():
        from live.export.run_mcap import write_run_mcap

        counts = write_run_mcap(RunFolder.find(source), out)
    typer.echo(f"{out} written: " + ", ".join(f"{topic} {n}" for topic, n in counts.items()))
