"""A field lattice in one file."""

from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from pyproj import CRS

from survey.core.config import validated
from survey.io.arrays_file import read_arrays, write_arrays
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_posterior import FieldPosterior
from survey.reconstruction.lattice.information import Information
from survey.reconstruction.lattice.recent_points import RecentPoints
from survey.reconstruction.lattice.stiffness import Stiffness
from survey.reconstruction.line_of_sight.ceiling import LowestRays
from survey.reconstruction.nodes import LatticeFrame, NodeWindow

if TYPE_CHECKING:
    from survey.reconstruction.lattice.field_lattice import FieldLattice

_FORMAT = "firnline field lattice 2"
_NOTHING = np.zeros((0, 0, 0))
Model = TypeVar("Model", bound="FieldLattice")


def write_field(path: str | Path, model: "FieldLattice") -> None:
    """Write a fitted model; equal models give equal bytes."""
    here, known = model.where, model.posterior
    window, information = here.window, known.information
    facts = {
        "config": model.config.model_dump(),
        "bounds": model.bounds,
        "window": [window.step_m, window.west, window.south, window.rows, window.columns],
        "datum_m": here.datum_m,
        "crs": here.crs.to_wkt(),
        "vertical_datum": here.vertical_datum,
        "stiffness": list(model.stiffness_),
        "n_scans": model.n_scans_,
        "n_ghosts": model.n_ghosts_,
        "n_points": information.n_points,
        "lengths": [len(scan) for scan in model.recent.scans],
    }
    arrays = {
        "stencil": information.stencil,
        "rhs": information.rhs,
        "draws": information.draws,
        "moments": information.moments,
        "z": known.z,
        "soft": _NOTHING if known.soft is None else known.soft,
        "recent": np.concatenate(model.recent.scans),
        "rays": _NOTHING if model.rays is None else np.stack([model.rays.height, model.rays.offset]),
    }
    write_arrays(path, _FORMAT, facts, arrays)


def read_field(path: str | Path, kind: type[Model]) -> Model:
    """Read what `write_field` wrote.

    Raises
    ------
    InputError
        When the file is missing, damaged or no field lattice.
    """
    facts, arrays = read_arrays(path, _FORMAT)
    config = validated(FieldLatticeConfig, facts["config"], "the field lattice's settings")
    model = kind(config, tuple(facts["bounds"]) if facts["bounds"] else None)
    window = NodeWindow(*facts["window"])
    information = Information(
        arrays["stencil"], arrays["rhs"], arrays["draws"], arrays["moments"], facts["n_points"]
    )
    ends = np.cumsum(facts["lengths"])[:-1]
    model.resume(
        LatticeFrame(window, facts["datum_m"], CRS.from_wkt(facts["crs"]), facts["vertical_datum"]),
        FieldPosterior(information, arrays["z"], arrays["soft"] if arrays["soft"].size else None),
        Stiffness(*facts["stiffness"]),
        RecentPoints(np.split(arrays["recent"], ends)),
        (facts["n_scans"], facts["n_ghosts"]),
        rays=LowestRays(*arrays["rays"]) if arrays["rays"].size else None,
    )
    return model
