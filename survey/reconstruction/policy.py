"""Choice of the reconstruction method and treatment of errors that landmarks share.

Missions, Monte Carlo studies and the command map landmarks by `map_landmarks`, so that all of them follow the same rules:

* points that name keyframes, of a path whose error is known, are mapped jointly with it (gp becomes joint), unless
  ``landmark_errors`` says that they count as independent;
* a joint map takes the prior's cells as measurements; another map is built around the prior, and points beyond its
  edge are left out;
* gross blunders of the heights are left out and named in the record;
* lines of sight bound the map when ``rays`` is set.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from survey.core import InputError, Progress, same_crs
from survey.data import Dem, Grid, PathError, SurfacePoints, SurveyArea
from survey.reconstruction.mapping import chosen_method, run
from survey.reconstruction.method import MappedTerrain, MappingTask
from survey.reconstruction.observations import sound_points
from survey.reconstruction.registry import LandmarkErrors, ReconstructionConfig
from survey.reconstruction.terrain_map import ELEVATION

logger = logging.getLogger(__name__)


def map_landmarks(
    points: SurfacePoints,
    grid: Grid,
    config: ReconstructionConfig,
    *,
    prior: Dem | None = None,
    path: PathError | None = None,
    quantity: str = ELEVATION,
    progress: Progress | None = None,
    area: SurveyArea | None = None,
    blunders: Sequence[Mapping[str, Any]] | None = None,
) -> MappedTerrain:
    """Map landmarks as the settings say."""
    prior = prior if config.use_prior else None
    method = chosen_method(config.method, path, config.landmark_errors)
    if blunders is None:
        points, blunders = sound_points(points, quantity, has_area=area is not None)
    if not method.needs_path:
        points = prepared(points, prior, config.landmark_errors)
        path = None
    prior = prior if method.uses_prior else None
    configs = config.configs_of(method)
    task = MappingTask(points, grid, prior, path, quantity, configs, config.rays, progress, area, blunders)
    mapped = run(method, task)
    return mapped._replace(n_points=len(points))


def prepared(points: SurfacePoints, prior: Dem | None, landmark_errors: LandmarkErrors) -> SurfacePoints:
    """Return points for a map that takes their errors as independent."""
    if landmark_errors == "independent" and points.own_covariance is not None:
        points = replace(points, covariance=points.own_covariance)
    return points if prior is None else within_prior(points, prior)


def within_prior(points: SurfacePoints, prior: Dem) -> SurfacePoints:
    """Leave out points beyond the prior's edge, where there is nothing to build around, and log their number."""
    same_crs(points.crs, prior.crs, "the points and the prior")
    known = np.isfinite(prior.at(points.xy))
    if not known.any():
        raise InputError(
            f"none of the {len(points)} points lies on the prior; take a prior of the same place, or leave it out."
        )
    if not known.all():
        logger.warning(
            "%d of %d landmarks lie beyond the prior and are left out", (~known).sum(), len(points)
        )
    return points.select(known)
