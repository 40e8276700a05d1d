"""Inputs of ``firnline reconstruct``: options and settings, checked against what the method needs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pyproj import CRS

import survey
from survey.core.config import Section, validated, with_overrides
from survey.core.errors import InputError
from survey.reconstruction.capacity import require_nodes
from survey.reconstruction.method import ReconstructionMethod
from survey.reconstruction.registry import METHODS, ReconstructionConfig, method_named, names_where

_POINT_TABLES = (".csv", ".gpkg", ".geojson", ".json")
_STEP_M, _SCAN_STEP_M = 1.0, 0.25


class _Settings(Section):
    reconstruction: ReconstructionConfig


@dataclass(frozen=True)
class MapRequest:
    """Sources, method and options of one map."""

    sources: list[Path]
    method: ReconstructionMethod
    config: ReconstructionConfig
    step_m: float
    prior: Path | None = None
    area: Path | None = None
    value: str | None = None
    crs: str | None = None
    sigma_m: float | None = None
    trajectory: Path | None = None
    quiet: bool = False

    @property
    def is_of_scans(self) -> bool:
        """Whether the sources are scans, and not one table of points."""
        return _are_scans(self.sources, self.method)

    @property
    def inputs(self) -> list[Path | None]:
        """Every file and folder that is read."""
        return [*self.sources, self.prior, self.area, self.trajectory]

    def read_area(self, crs: CRS) -> survey.SurveyArea | None:
        """Return the area to map, in the points' CRS."""
        if self.area is None:
            return None
        area = survey.SurveyArea.read(self.area, crs=crs)
        area.require_crs(crs, "the points")
        return area

    def grid_over(self, bounds: tuple[float, float, float, float], crs: CRS) -> survey.Grid:
        """Return the nodes over bounds [m], or refuse more of them than fit into memory."""
        self.method.require_room(bounds, self.step_m, self.config.configs_of(self.method))
        return survey.Grid.over(bounds, self.step_m, crs)


def map_request(
    sources: list[Path],
    *,
    method: str | None,
    step_m: float | None,
    rays: bool,
    product: str | None,
    settings: Sequence[str],
    **options: Any,
) -> MapRequest:
    """Return the checked request.

    Raises
    ------
    InputError
        An option that the method does not use, or one that it lacks.
    ConfigError
        A setting that is unknown or wrong.
    """
    if method is not None:
        method_named(method)
    given = {"method": method, "grid_step_m": step_m, "rays": rays or None}
    if step_m is not None:
        require_nodes((0.0, 0.0, 0.0, 0.0), step_m, 0.0)
    values = {"reconstruction": {key: value for key, value in given.items() if value is not None}}
    if product is not None:
        settings = [f"reconstruction.joint.satellite.product={product}", *settings]
    config = validated(_Settings, with_overrides(values, settings), "--set").reconstruction
    chosen = method_named(config.method)
    default_m = _SCAN_STEP_M if _are_scans(sources, chosen) else _STEP_M
    is_stated = "grid_step_m" in config.model_fields_set
    request = MapRequest(sources, chosen, config, config.grid_step_m if is_stated else default_m, **options)
    if product is not None and request.prior is None:
        raise InputError(
            "--product names the class of a prior; add --prior with its file, or leave --product out."
        )
    _refuse_unused(request)
    return request


def _are_scans(sources: Sequence[Path], method: ReconstructionMethod) -> bool:
    return method.begin is not None and (len(sources) > 1 or sources[0].suffix.lower() not in _POINT_TABLES)


def _refuse_unused(request: MapRequest) -> None:
    """Refuse options that the method does not use, and name the methods that do."""
    method = request.method
    if len(request.sources) > 1 and method.begin is None:
        raise InputError(
            f"{len(request.sources)} files were named, and the method {method.name!r} maps one; name one, or take "
            f"{names_where(m for m in METHODS.values() if m.begin)}."
        )
    if request.prior is not None and not method.uses_prior:
        raise InputError(
            f"the method {method.name} uses no prior; leave --prior out, or take "
            f"{names_where(m for m in METHODS.values() if m.uses_prior)}."
        )
    if request.trajectory is not None and not (method.needs_path or request.is_of_scans):
        raise InputError(
            f"the method {method.name} does not use a trajectory; take --method joint, or leave --trajectory out."
        )
    if method.needs_path and request.trajectory is None:
        raise InputError(
            "the method joint needs the path that the points were seen from; add --trajectory trajectory.csv, with "
            "trajectory.error.npz beside it."
        )
    if request.config.rays and method.sight_lines == "none":
        raise InputError(
            f"the method {method.name} uses no lines of sight; take field or carving, or leave --rays out."
        )
