"""Posterior of the error of a Gaussian-process map."""

from dataclasses import replace

import numpy as np

from survey.data.area import SurveyArea
from survey.reconstruction.base import BEYOND, CLAIM, Reconstruction
from survey.reconstruction.checks.rmse_claim import RmseClaim, sampled_nodes
from survey.reconstruction.gp.learned import Learned


def with_claim(result: Reconstruction, learned: Learned, area: SurveyArea | None) -> Reconstruction:
    """Return a map with the posterior of its error in the record; maps in tiles have no joint covariance, and none.

    Parameters
    ----------
    result : Reconstruction
        Map of the fitted model.
    learned : Learned
        State of the model.
    area : SurveyArea, optional
        Ground of which the error is claimed; the grid by default.
    """
    grid, std = result.mean.grid(), result.std.elevation
    inside = np.isfinite(std)
    if area is not None:
        inside &= area.contains(grid.xy).reshape(grid.shape)
    if learned.process.divides_site or not inside.any():
        return result
    rows = sampled_nodes(inside)
    covariance = learned.process.joint_covariance(grid.xy[rows])
    covariance[np.diag_indices(len(rows))] += learned.found.nugget_m**2
    untested_share = result.diagnostics.get(BEYOND, {}).get("share", 0.0)
    claim = replace(RmseClaim.of(covariance, std.ravel()[rows]), untested_share=untested_share)
    return replace(result, diagnostics={**result.diagnostics, CLAIM: claim.facts()})
