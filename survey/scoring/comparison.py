"""Comparison of a reconstruction with a reference terrain, node by node."""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.crs.vertical_datum import same_vertical_datum
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.reconstruction.base import ELEVATION, Reconstruction
from survey.scoring.covered_area import NodeCounts, counted, nodes_beyond


class NodeComparison(NamedTuple):
    """Errors and stated deviations (N,) [m] where they exist, the counts of nodes, and which nodes were scored."""

    errors: FloatArray
    std: FloatArray
    nodes: NodeCounts
    scored: BoolArray


def mean_and_std(reconstruction: Reconstruction | Dem) -> tuple[Dem, FloatArray]:
    """Return the heights and their claimed deviations (H, W) [m], NaN where nothing is claimed."""
    if isinstance(reconstruction, Dem):
        return reconstruction, np.full(reconstruction.shape, np.nan)
    if reconstruction.quantity != ELEVATION:
        raise InputError(f"the map shows {reconstruction.quantity}; only maps of {ELEVATION} can be scored.")
    return reconstruction.mean, reconstruction.std.elevation


def compare(mean: Dem, std: FloatArray, truth: Dem, area: SurveyArea | None) -> NodeComparison:
    """Return the errors of the map at the nodes where area, reference and map have a value."""
    nodes = mean.xy
    heights, reference = mean.elevation.ravel(), np.full(len(nodes), np.nan)
    inside = np.ones(len(nodes), dtype=bool) if area is None else area.contains(nodes)
    reference[inside] = truth.at(nodes[inside])
    scored = inside & np.isfinite(reference) & np.isfinite(heights)
    if not scored.any():
        n_known = int(np.isfinite(reference).sum())
        raise InputError(
            f"there is nothing to score: of {len(nodes)} nodes of the map {int(inside.sum())} lie in the area, "
            f"{n_known} of those on the reference and {int(scored.sum())} have a height in both; check that the three overlap."
        )
    counts = counted(heights, reference, inside, has_area=area is not None)
    beyond = 0 if area is None else nodes_beyond(mean.bounds, mean.step_m, area)
    return NodeComparison(
        (heights - reference)[scored],
        std.ravel()[scored],
        counts._replace(silent=counts.silent + beyond),
        scored,
    )


def check_systems(mean: Dem, truth: Dem, area: SurveyArea | None) -> None:
    """Refuse what cannot be compared."""
    same_crs(mean.crs, truth.crs, "the map and the reference")
    same_vertical_datum(mean.vertical_datum, truth.vertical_datum, "the map and the reference")
    if area is not None:
        area.require_crs(mean.crs, "the map")
