"""Carved surfaces in one file."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pyproj import CRS

from survey.core.config import validated
from survey.io.arrays_file import read_arrays, write_arrays
from survey.reconstruction.carving.bases import Bases, Columns
from survey.reconstruction.carving.carved_surface import CarvedSurface, Frame
from survey.reconstruction.carving.cloud import CarvingFrame, Cloud
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.descent import Step

if TYPE_CHECKING:
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

_FORMAT = "firnline space-carving kernels 1"
Model = TypeVar("Model", bound="SpaceCarvingKernel")


def write_carving(path: str | Path, model: "SpaceCarvingKernel") -> None:
    """Write a model; equal models give equal bytes."""
    where, cloud = model.where, model.cloud
    facts = {
        "config": model.config.model_dump(),
        "place": [where.west, where.south, where.step_m, where.datum_m],
        "crs": where.crs.to_wkt(),
        "vertical_datum": where.vertical_datum,
        "size_m": [model.frame.width_m, model.frame.height_m],
        "spread_m": model.spread_m_,
        "n_scans": model.n_scans_,
        "n_ghosts": model.n_ghosts_,
        "n_learned": model.n_learned_,
        "steps": {name: list(surface.step) for name, surface in model.surfaces_.items()},
    }
    arrays: dict[str, Any] = {
        "hits": cloud.xyz,
        "origins": cloud.origins,
        "sigma_m": cloud.sigma_m,
        "held": cloud.held,
    }
    for name, surface in model.surfaces_.items():
        arrays |= {f"{name}_{column}": v for column, v in surface.bases().columns()._asdict().items()}
        arrays[f"{name}_raster"] = surface.raster
    write_arrays(path, _FORMAT, facts, arrays)


def read_carving(path: str | Path, kind: type[Model]) -> Model:
    """Read what `write_carving` wrote.

    Raises
    ------
    InputError
        When the file is missing, damaged or holds something else.
    """
    facts, arrays = read_arrays(path, _FORMAT)
    model = kind(validated(SpaceCarvingConfig, facts["config"], "the settings of the space-carving kernels"))
    west, south, step_m, datum_m = facts["place"]
    model.place = CarvingFrame(
        west, south, step_m, datum_m, CRS.from_wkt(facts["crs"]), facts["vertical_datum"]
    )
    width_m, height_m = facts["size_m"]
    model.frame = Frame.over(width_m, height_m, model.config.lengths_m())
    model.cloud = Cloud(arrays["hits"], arrays["origins"], arrays["sigma_m"], arrays["held"])
    model.spread_m_, model.n_scans_ = facts["spread_m"], facts["n_scans"]
    model.n_ghosts_, model.n_learned_ = facts["n_ghosts"], facts["n_learned"]
    none = Bases.none(model.frame.cells)
    model.surfaces_ = {
        name: CarvedSurface(
            model.frame,
            Step(*step),
            none.merged(Columns(*(arrays[f"{name}_{column}"] for column in Columns._fields))),
            none,
            arrays[f"{name}_raster"],
        )
        for name, step in facts["steps"].items()
    }
    return model
