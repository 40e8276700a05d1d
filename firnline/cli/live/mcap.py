"""MCAP files for ``firnline export``."""

from pathlib import Path

import typer

from firnline.cli.live.options import needs_live_extra


def export_mcap(source: Path, out: Path) -> None:
    """Write the MCAP file of a run, or of a survey that was watched."""
    from survey.core.run_folder import RunFolder

    with needs_live_extra():
        from live.mcap_files import write_drive_mcap, write_run_mcap

        is_run = source.is_dir()
        counts = write_run_mcap(RunFolder.find(source), out) if is_run else write_drive_mcap(source, out)
    typer.echo(f"{out} written: " + ", ".join(f"{topic} {n}" for topic, n in counts.items()))
