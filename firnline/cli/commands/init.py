"""``firnline init``: write a mission file with every setting explained."""

from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.facts import end_dry_run
from firnline.cli.options import DryRun
from firnline.cli.outcome import with_exit_codes


@with_exit_codes
def init(
    path: Annotated[Path, typer.Argument(help="The mission file to write.")] = Path("mission.toml"),
    dem: Annotated[
        Path | None,
        typer.Option("--dem", help="Survey this fine elevation raster instead of random terrain."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    dry_run: DryRun = False,
) -> None:
    """Write a mission file with every setting, its unit and its default.

    For example:

      firnline init my-survey.toml

      firnline init my-survey.toml --dem copernicus.tif
    """
    import numpy as np

    from firnline.cli.outputs import refuse_existing
    from sim.mission.runs import mission_template
    from survey.core.files import replacing
    from survey.core.replacement import resolved
    from survey.data.dem import Dem

    refuse_existing([path], force=force, inputs=[dem])
    has_voids = dem is not None and not np.isfinite(Dem.read(dem).elevation).all()
    if dry_run:
        end_dry_run([path])
    with replacing(resolved(path)) as draft:
        draft.write_text(mission_template(path.stem, dem, clip_to_terrain=has_voids), encoding="utf-8")
    ground = "random terrain" if dem is None else f"the ground of {dem}"
    typer.echo(f"{path} written: 4 swaths on {ground}; every other setting is explained and at its default")
    typer.echo(f"edit it, then run: firnline run {path}")
