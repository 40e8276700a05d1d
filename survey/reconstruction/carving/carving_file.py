"""Reading and writing of space-carving kernels in one file."""

from pathlib import Path
from typing import Any, NamedTuple

from pyproj import CRS

from survey.core.config import validated
from survey.io.arrays_file import read_arrays, write_arrays
from survey.reconstruction.carving.carved_surface import CarvedSurface, CarvingFrame, Cloud, Frame
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.descent import Bases, Columns, Step

_FORMAT = "firnline space-carving kernels 1"


class CarvingState(NamedTuple):
    """Everything that a fitted space-carving model is made of."""

    config: SpaceCarvingConfig
    where: CarvingFrame
    frame: Frame
    cloud: Cloud
    surfaces: dict[str, CarvedSurface]
    spread_m: float
    n_scans: int
    n_ghosts: int
    n_learned: int


def write_carving(path: str | Path, model: CarvingState) -> None:
    """Write a model; equal models give equal bytes."""
    where, cloud = model.where, model.cloud
    facts = {
        "config": model.config.model_dump(),
        "place": [where.west, where.south, where.step_m, where.datum_m],
        "crs": where.crs.to_wkt(),
        "vertical_datum": where.vertical_datum,
        "size_m": [model.frame.width_m, model.frame.height_m],
        "spread_m": model.spread_m,
        "n_scans": model.n_scans,
        "n_ghosts": model.n_ghosts,
        "n_learned": model.n_learned,
        "steps": {name: list(surface.step) for name, surface in model.surfaces.items()},
    }
    arrays: dict[str, Any] = {
        "hits": cloud.xyz,
        "origins": cloud.origins,
        "sigma_m": cloud.sigma_m,
        "held": cloud.held,
    }
    for name, surface in model.surfaces.items():
        arrays |= {f"{name}_{column}": v for column, v in surface.bases().columns()._asdict().items()}
        arrays[f"{name}_raster"] = surface.raster
    write_arrays(path, _FORMAT, facts, arrays)


def read_carving(path: str | Path) -> CarvingState:
    """Read what `write_carving` wrote.

    Raises
    ------
    InputError
        When the file is missing, damaged or holds something else.
    """
    facts, arrays = read_arrays(path, _FORMAT)
    config = validated(SpaceCarvingConfig, facts["config"], "the settings of the space-carving kernels")
    crs = CRS.from_wkt(facts["crs"])
    width_m, height_m = facts["size_m"]
    frame = Frame.over(width_m, height_m, config.lengths_m())
    west, south, step_m, datum_m = facts["place"]
    none = Bases.none(frame.cells)
    surfaces = {
        name: CarvedSurface(
            frame,
            Step(*step),
            none.merged(Columns(*(arrays[f"{name}_{column}"] for column in Columns._fields))),
            none,
            arrays[f"{name}_raster"],
        )
        for name, step in facts["steps"].items()
    }
    return CarvingState(
        config,
        CarvingFrame(west, south, step_m, datum_m, crs, facts["vertical_datum"]),
        frame,
        Cloud(arrays["hits"], arrays["origins"], arrays["sigma_m"], arrays["held"]),
        surfaces,
        facts["spread_m"],
        facts["n_scans"],
        facts["n_ghosts"],
        facts["n_learned"],
    )
