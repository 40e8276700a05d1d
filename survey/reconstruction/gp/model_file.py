"""Reading and writing of a fitted Gaussian-process terrain: points, mean, hyperparameters and calibration."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from affine import Affine

from survey.core import Bounds, InputError, validated
from survey.data import Dem
from survey.io.arrays_file import read_npz, write_npz
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engine_choice import EngineName, fit_process
from survey.reconstruction.gp.families import kernel_of
from survey.reconstruction.gp.fit import Learned, SigmaCalibration
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters
from survey.reconstruction.gp.mean import ConstantMean, DemMean, Mean, with_prior_error
from survey.reconstruction.observations import Outliers

_FORMAT = "firnline terrain model 1"


class TerrainState(NamedTuple):
    """Everything that a fitted Gaussian-process terrain is made of."""

    config: GaussianProcessConfig
    prior: Dem | Mean | None
    engine: EngineName
    quantity: str
    bounds: Bounds | None
    vertical_datum: str
    learned: Learned


def write_model(path: str | Path, model: TerrainState) -> None:
    """Write a fitted model; equal models give equal bytes."""
    known = model.learned
    arrays: dict[str, Any] = {
        "xy": known.process.data.xy,
        "values": known.process.data.values,
        "noise_m2": known.process.data.noise_m2,
        "log_parameters": known.process.kernel.log_parameters,
        "calibration": np.stack([known.calibration.distance_m, known.calibration.scale]),
        "outlier_rows": known.outliers.index,
        "outlier_z": known.outliers.z,
    }
    facts = {
        "format": _FORMAT,
        "config": model.config.model_dump(mode="json"),
        "engine": model.engine,
        "quantity": model.quantity,
        "bounds": model.bounds,
        "vertical_datum": model.vertical_datum,
        "family": known.hyperparameters.family,
        "nugget_m": known.hyperparameters.nugget_m,
        "log_likelihood": known.hyperparameters.log_likelihood,
        "held_out": known.calibration.held_out,
        "treatment": known.outliers.treatment,
        "n_beyond_reach": known.n_beyond_reach,
        **_prior_facts(model.prior, arrays),
    }
    arrays["facts"] = np.frombuffer(json.dumps(facts, sort_keys=True).encode("utf-8"), dtype=np.uint8)
    write_npz(path, arrays, compressed=False)


def _prior_facts(prior: Dem | Mean | None, arrays: dict[str, Any]) -> dict[str, Any]:
    if prior is None:
        return {"prior": "none"}
    if isinstance(prior, ConstantMean):
        return {"prior": "constant", "value_m": prior.value_m}
    if not isinstance(prior, Dem):
        raise InputError("a model whose mean is a function cannot be written; give the prior as a Dem.")
    arrays["prior"] = prior.elevation
    return {
        "prior": "dem",
        "transform": list(prior.transform)[:6],
        "crs": prior.crs.to_wkt(),
        "datum": prior.vertical_datum,
    }


def read_model(path: str | Path) -> TerrainState:
    """Read what `write_model` wrote, and fit_process on its points again."""
    arrays = read_npz(path, "the terrain model", "save it again")
    try:
        facts: dict[str, Any] = json.loads(arrays["facts"].tobytes().decode("utf-8"))
        if facts["format"] != _FORMAT:
            raise InputError(f"{path} has the format {facts['format']!r}; {_FORMAT!r} was expected.")
    except InputError:
        raise
    except (ValueError, KeyError) as error:
        raise InputError(f"{path} is no terrain model ({error}); save it again.") from error
    return _rebuilt(arrays, facts)


def _rebuilt(arrays: dict[str, Any], facts: dict[str, Any]) -> TerrainState:
    config = validated(GaussianProcessConfig, facts["config"], "the terrain model's settings")
    prior = _prior_of(facts, arrays)
    found = _hyperparameters(arrays, facts, config, prior)
    conditioned = fit_process(
        facts["engine"],
        found.kernel,
        arrays["xy"],
        arrays["values"],
        np.sqrt(arrays["noise_m2"]),
        bounds=tuple(facts["bounds"]) if facts["bounds"] else None,
        trend=config.trend(has_prior=prior is not None),
        config=config,
    )
    mean = (
        DemMean(prior, config.prior_interpolation) if isinstance(prior, Dem) else prior or ConstantMean(0.0)
    )
    distance, scale = arrays["calibration"]
    calibration = SigmaCalibration(distance, scale, facts["held_out"])
    outliers = Outliers(arrays["outlier_rows"], arrays["outlier_z"], facts["treatment"])
    learned = Learned(*conditioned, mean, found, calibration, outliers, facts["n_beyond_reach"])
    bounds = tuple(facts["bounds"]) if facts["bounds"] else None
    return TerrainState(
        config, prior, facts["engine"], facts["quantity"], bounds, facts["vertical_datum"], learned
    )


def _hyperparameters(
    arrays: dict[str, Any], facts: dict[str, Any], config: GaussianProcessConfig, prior: Dem | Mean | None
) -> Hyperparameters:
    shape = config.kernel or kernel_of(
        facts["family"],
        1.0,
        1.0,
        anisotropy=config.anisotropy,
        angle_deg=config.angle_deg,
        shape=config.shape,
    )
    if isinstance(prior, Dem) and config.prior_sigma_m:
        shape = with_prior_error(shape, prior.step_m, config.prior_sigma_m)
    kernel = shape.with_log_parameters(arrays["log_parameters"])
    return Hyperparameters(facts["family"], kernel, facts["nugget_m"], facts["log_likelihood"])


def _prior_of(facts: dict[str, Any], arrays: dict[str, Any]) -> Dem | ConstantMean | None:
    if facts["prior"] == "dem":
        return Dem(arrays["prior"], Affine(*facts["transform"]), facts["crs"], facts["datum"])
    return ConstantMean(facts["value_m"]) if facts["prior"] == "constant" else None
