"""Reading and writing of a field lattice in one file."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from pyproj import CRS

from survey.core.arrays import Bounds
from survey.core.config import validated
from survey.io.arrays_file import read_arrays, write_arrays
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_posterior import FieldPosterior
from survey.reconstruction.lattice.information import Information
from survey.reconstruction.lattice.recent_points import RecentPoints
from survey.reconstruction.lattice.stiffness import Stiffness
from survey.reconstruction.line_of_sight.ceiling import LowestRays
from survey.reconstruction.nodes import LatticeFrame, NodeWindow

_FORMAT = "firnline field lattice 2"
_NOTHING = np.zeros((0, 0, 0))


class FieldState(NamedTuple):
    """Everything that a fitted field lattice is made of."""

    config: FieldLatticeConfig
    bounds: Bounds | None
    where: LatticeFrame
    posterior: FieldPosterior
    stiffness: Stiffness
    recent: RecentPoints
    n_scans: int
    n_ghosts: int
    rays: LowestRays | None


def write_field(path: str | Path, model: FieldState) -> None:
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
        "stiffness": list(model.stiffness),
        "n_scans": model.n_scans,
        "n_ghosts": model.n_ghosts,
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


def read_field(path: str | Path) -> FieldState:
    """Read what `write_field` wrote.

    Raises
    ------
    InputError
        When the file is missing, damaged or no field lattice.
    """
    facts, arrays = read_arrays(path, _FORMAT)
    config = validated(FieldLatticeConfig, facts["config"], "the field lattice's settings")
    window = NodeWindow(*facts["window"])
    information = Information(
        arrays["stencil"], arrays["rhs"], arrays["draws"], arrays["moments"], facts["n_points"]
    )
    ends = np.cumsum(facts["lengths"])[:-1]
    return FieldState(
        config,
        tuple(facts["bounds"]) if facts["bounds"] else None,
        LatticeFrame(window, facts["datum_m"], CRS.from_wkt(facts["crs"]), facts["vertical_datum"]),
        FieldPosterior(information, arrays["z"], arrays["soft"] if arrays["soft"].size else None),
        Stiffness(*facts["stiffness"]),
        RecentPoints(np.split(arrays["recent"], ends)),
        facts["n_scans"],
        facts["n_ghosts"],
        LowestRays(*arrays["rays"]) if arrays["rays"].size else None,
    )
