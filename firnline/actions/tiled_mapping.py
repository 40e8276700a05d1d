"""Map point files that do not fit the memory, tile by tile."""

import logging
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import survey
from firnline.actions.interface import (
    Preview,
    Progress,
    Result,
    area_if_named,
    fact_line,
    figure_lines,
    no_progress,
    previewed_by,
    read_about,
)
from firnline.actions.requests import PictureOptions, ReconstructRequest
from survey.core import (
    InputError,
    Section,
    existing_file,
    picture_files,
    same_vertical_datum,
    validated,
    with_overrides,
)
from survey.core.executors import open_workers
from survey.reconstruction.tiled.global_parameters import coarse_nodes
from survey.reconstruction.tiled.job import Control, TiledConfig, TiledJob, disk_bytes, fingerprint, tiled_job
from survey.reconstruction.tiled.survey_map import map_in_tiles as make_map
from survey.reconstruction.tiled.survey_map import prior_on_nodes
from survey.reconstruction.tiled.tile_map import TiledResult

OWN_FILES = (
    *("dem.vrt", "support.vrt", "coverage.tif", "reconstruction.json"),
    *picture_files("withheld"),
    *("tiles/dem_*.tif", "tiles/support_*.tif", "*.aux.xml", "work/*"),
)
"""Patterns of the files that a map in tiles consists of."""


class _Settings(Section):
    tiles: TiledConfig


@dataclass(frozen=True)
class TiledMapResult(Result):
    """A map in tiles, whose files are written while it is made.

    Parameters
    ----------
    job : TiledJob
        Layout and settings.
    result : TiledResult
        Record, and the test by withheld cells.
    pictures : PictureOptions
        Whether the test is drawn beside the map, and in which format.
    """

    job: TiledJob
    result: TiledResult
    pictures: PictureOptions

    def write(self) -> "TiledMapResult":
        """Draw the test by withheld cells beside the map.

        Returns
        -------
        TiledMapResult
            The same.
        """
        from survey.figures.calibration import withheld_plot

        test, coverage = self.result.test, self.result.coverage
        self.pictures.write_pictures(
            self.job.folder,
            lambda: {
                "withheld": withheld_plot(test.reliability, coverage.share, coverage.bounds, self.job.map_crs)
            },
        )
        return self

    @property
    def notes(self) -> list[str]:
        """A map that fails its own check, in capital letters at the front."""
        return [f"WARNING: {each}." for each in self.result.facts["diagnostics"].get("warnings", ())]

    def facts(self) -> dict[str, Any]:
        """Return the record of the map."""
        return self.result.facts

    def as_json(self) -> str:
        """Return the record of the map as it was written."""
        return (self.job.folder / "reconstruction.json").read_text(encoding="utf-8")

    def lines(self) -> list[str]:
        """Return size, hyperparameters, strips and the share within the interval."""
        extent, test, found = self.job.layout.extent, self.result.test, self.result.facts["diagnostics"]
        place = self.job.folder / "dem.vrt"
        lines = [
            f"{extent.rows} × {extent.columns} cells in tiles, written to {place}",
            *figure_lines(self.result.facts["hyperparameters"]),
            fact_line("strips", f"{len(found['strips'])}, {found['n_overlap_blocks']} blocks of overlap"),
        ]
        lines += [fact_line("left out", each["sentence"]) for each in found.get("blunders", ())]
        lines += [fact_line("warning", each["sentence"]) for each in found.get("contradictions", ())]
        if test.n:
            share = 100.0 * test.coverage_95
            lines.append(fact_line("withheld", f"{share:.1f} % of {test.n:,} cells within the 95 % interval"))
        return lines


def preview_tiles(request: ReconstructRequest) -> Preview:
    """Read and check all input of a map in tiles, and return the size of the work."""
    return Preview.of([request.out], _facts(_checked_job(request, removes=False)))


@previewed_by(preview_tiles)
def map_in_tiles(
    request: ReconstructRequest,
    progress: Progress = no_progress,
    announce: Callable[[str], None] = lambda _: None,
) -> TiledMapResult:
    """Map point files of any size tile by tile, or go on with a map that was begun.

    Parameters
    ----------
    request : ReconstructRequest
        With ``tiles``.
    progress : callable
        Called with what is done, how many are done, and how many there are.
    announce : callable
        Called with a line about the size of the work before it starts.

    Returns
    -------
    TiledMapResult
        The map, whose files are in the folder of the request.

    Raises
    ------
    InputError
        Options that maps in tiles do not use, a finished map, or input that cannot be used.
    """
    job = _checked_job(request)
    request.out.mkdir(parents=True, exist_ok=True)
    if request.prior is not None and not job.prior_file.exists():
        _store_prior(request.prior, job, request.units)
    announce(fact_line("work", "; ".join(_facts(job).values())))
    engine: Any = "dask" if request.scheduler else "serial" if request.workers == 1 else "processes"
    with open_workers(engine, request.workers, request.scheduler) as run:
        return TiledMapResult(job, make_map(job, run, progress), request)


def _checked_job(request: ReconstructRequest, *, removes: bool = True) -> TiledJob:
    """Return the job of a request that was checked."""
    _refuse_unused(request)
    _prepare(request, removes=removes)
    job = tiled_job(
        request.sources,
        request.out,
        _config(request),
        crs=request.crs,
        bounds=_bounds(request),
        units=request.units,
    )
    if request.control is not None:
        job = job._replace(control=_control(request.control, job, request.units))
    if request.prior is not None:
        job = job._replace(prior=fingerprint(existing_file(request.prior, "the prior")))
    return job


def _config(options: ReconstructRequest) -> TiledConfig:
    given = {} if options.step_m is None else {"cell_m": options.step_m}
    return validated(_Settings, with_overrides({"tiles": given}, options.settings), "--set").tiles


def _refuse_unused(options: ReconstructRequest) -> None:
    """Refuse options that maps in tiles do not use."""
    unused = {
        "--method": options.method,
        "--value": options.value,
        "--sigma": options.sigma_m,
        "--columns": options.columns or None,
        "--format": options.layout,
        "--trajectory": options.trajectories or None,
        "--rays": options.rays or None,
        "--max-slope": options.max_slope_deg,
        "--product": options.product,
        "--ground": None if options.ground == "auto" else options.ground,
    }
    if options.adjust_strips:
        raise InputError("maps in tiles adjust strips in any case; leave --adjust-strips out.")
    for name, value in unused.items():
        if value is not None:
            raise InputError(f"maps in tiles do not use {name}; leave it out, or leave --tiles out.")


def _prepare(options: ReconstructRequest, *, removes: bool) -> None:
    """Refuse a finished map in the folder, or foreign files; remove what is there with --force."""
    from survey.core.replacement import refuse_foreign

    refuse_foreign(options.out, OWN_FILES)
    if options.force and options.out.exists() and removes:
        shutil.rmtree(options.out)
    if (options.out / "reconstruction.json").exists():
        raise InputError(
            f"{options.out} holds a finished map; choose another folder with --out, or add --force."
        )


def _bounds(options: ReconstructRequest) -> tuple[float, float, float, float] | None:
    """Return the box about the area that is named."""
    area = area_if_named(options.area, options, options.crs)
    return None if area is None else area.bounds


def _control(file: Path, job: TiledJob, units: str | None) -> Control:
    """Read control points with their standard deviations."""
    points = survey.SurfacePoints.read(file, crs=job.map_crs, units=units)
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


def _store_prior(file: Path, job: TiledJob, units: str | None) -> None:
    """Store the prior's heights at the nodes of the long relief."""
    window = coarse_nodes(job.layout, job.config.coarse_cells)
    prior = read_about(file, window.bounds, job.map_crs, "the prior", units=units)
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
