"""Map point files that do not fit the memory, tile by tile."""

import logging
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import typer

import survey
from firnline.actions.files import read_about
from firnline.actions.interface import end_dry_run, fact_line, figure_lines
from firnline.actions.mapping_request import ReconstructOptions
from firnline.cli.progress import counted
from survey.core.config import Section, validated, with_overrides
from survey.core.crs.vertical_datum import same_vertical_datum
from survey.core.errors import InputError
from survey.core.executors import open_workers
from survey.core.files.reading import existing_file
from survey.reconstruction.tiled.cells.disk_space import disk_bytes
from survey.reconstruction.tiled.config import TiledConfig
from survey.reconstruction.tiled.job import Control, TiledJob
from survey.reconstruction.tiled.relief.long_relief import coarse_nodes
from survey.reconstruction.tiled.request import fingerprint, tiled_job
from survey.reconstruction.tiled.results import TiledResult
from survey.reconstruction.tiled.survey_map import map_in_tiles, prior_on_nodes

OWN_FILES = (
    *("dem.vrt", "support.vrt", "coverage.tif", "reconstruction.json", "withheld.png"),
    *("tiles/dem_*.tif", "tiles/support_*.tif", "*.aux.xml", "work/*"),
)
"""Patterns of the files that a map in tiles consists of."""


class _Settings(Section):
    tiles: TiledConfig


def map_tiled(options: ReconstructOptions) -> None:
    """Check the request, make the map or go on with it, and print it."""
    _refuse_unused(options)
    _prepare(options)
    job = tiled_job(options.sources, options.out, _config(options), crs=options.crs, bounds=_bounds(options))
    if options.control is not None:
        job = job._replace(control=_control(options.control, job))
    if options.prior is not None:
        job = job._replace(prior=fingerprint(existing_file(options.prior, "the prior")))
    facts = _facts(job)
    if options.dry_run:
        end_dry_run([options.out], facts)
    options.out.mkdir(parents=True, exist_ok=True)
    if options.prior is not None and not job.prior_file.exists():
        _store_prior(options.prior, job)
    if not options.quiet:
        typer.echo(fact_line("work", "; ".join(facts.values())), err=True)
    engine: Any = "dask" if options.scheduler else "serial" if options.workers == 1 else "processes"
    workers = open_workers(engine, options.workers, options.scheduler)
    with workers as run, counted(quiet=options.quiet) as progress:
        result = map_in_tiles(job, run, progress)
    _draw(result, options.out)
    _print(result, job, options)


def _config(options: ReconstructOptions) -> TiledConfig:
    given = {} if options.step_m is None else {"cell_m": options.step_m}
    return validated(_Settings, with_overrides({"tiles": given}, options.settings), "--set").tiles


def _refuse_unused(options: ReconstructOptions) -> None:
    """Refuse options that maps in tiles do not use."""
    unused = {
        "--method": options.method,
        "--value": options.value,
        "--sigma": options.sigma_m,
        "--trajectory": options.trajectories or None,
        "--rays": options.rays or None,
        "--max-slope": options.max_slope_deg,
        "--product": options.product,
    }
    for name, value in unused.items():
        if value is not None:
            raise InputError(f"maps in tiles do not use {name}; leave it out, or leave --tiles out.")


def _prepare(options: ReconstructOptions) -> None:
    """Refuse a finished map in the folder, or foreign files; remove what is there with --force."""
    from survey.core.files.replacing import refuse_foreign

    refuse_foreign(options.out, OWN_FILES)
    if options.force and options.out.exists() and not options.dry_run:
        shutil.rmtree(options.out)
    if (options.out / "reconstruction.json").exists():
        raise InputError(
            f"{options.out} holds a finished map; choose another folder with --out, or add --force."
        )


def _bounds(options: ReconstructOptions) -> tuple[float, float, float, float] | None:
    """Return the box about the area that is named."""
    if options.area is None:
        return None
    area = survey.SurveyArea.read(options.area, crs=options.crs)
    return area.bounds


def _control(file: Path, job: TiledJob) -> Control:
    """Read control points with their standard deviations."""
    points = survey.SurfacePoints.read(file, crs=job.map_crs)
    same_vertical_datum(points.vertical_datum, job.vertical_datum, "the control points and the points")
    every = Control(np.asarray(points.xyz), np.asarray(points.sigma_z))
    control = every.within(job.layout.extent, job.layout.cell_m)
    n_beside = len(every.xyz) - len(control.xyz)
    if n_beside == len(every.xyz):
        raise InputError(
            f"none of the {n_beside} control points of {file} lies on the map; take points on it, or leave --control out."
        )
    if n_beside:
        logging.getLogger(__name__).warning(
            "%s: %d of %d control points lie beside the map and are left out.", file, n_beside, len(every.xyz)
        )
    return control


def _store_prior(file: Path, job: TiledJob) -> None:
    """Store the prior's heights at the nodes of the long relief."""
    window = coarse_nodes(job.layout, job.config.coarse_cells)
    prior = read_about(file, window.bounds, job.map_crs, "the prior")
    heights = prior.at(window.xy).reshape(window.shape)
    if not np.isfinite(heights).any():
        raise InputError(
            f"the prior {file} has no height on the map; give one that covers it, or leave --prior out."
        )
    prior_on_nodes(job, heights)


def _facts(job: TiledJob) -> dict[str, str]:
    """Return the size of the work, for people."""
    rows, columns = job.layout.shape
    extent = job.layout.extent
    n_points = sum(piece.n for piece in job.pieces)
    return {
        "points": f"{n_points:,} points in {len({piece.file for piece in job.pieces})} files",
        "map": f"{extent.rows:,} × {extent.columns:,} cells of {job.layout.cell_m:g} m in {rows * columns} tiles",
        "disk": f"up to {disk_bytes(n_points, extent.rows * extent.columns) / 1e9:.3g} GB of disk while it runs",
    }


def _draw(result: TiledResult, out: Path) -> None:
    from survey.figures import png_bytes
    from survey.figures.checks.withheld import withheld_plot

    figure = withheld_plot(result.test.reliability, result.coverage.share, result.coverage.bounds)
    (out / "withheld.png").write_bytes(png_bytes(figure))


def _print(result: TiledResult, job: TiledJob, options: ReconstructOptions) -> None:
    """Print what was made, for people or as JSON."""
    if options.as_json:
        typer.echo((options.out / "reconstruction.json").read_text(encoding="utf-8"))
        return
    extent = job.layout.extent
    typer.echo(f"{extent.rows} × {extent.columns} cells in tiles, written to {options.out / 'dem.vrt'}")
    for line in figure_lines(result.facts["hyperparameters"]):
        typer.echo(line)
    n_strips = len(result.facts["diagnostics"]["strips"])
    typer.echo(
        fact_line(
            "strips", f"{n_strips}, {result.facts['diagnostics']['n_overlap_blocks']} blocks of overlap"
        )
    )
    if result.test.n:
        share = 100.0 * result.test.coverage_95
        typer.echo(
            fact_line("withheld", f"{share:.1f} % of {result.test.n:,} cells within the 95 % interval")
        )
