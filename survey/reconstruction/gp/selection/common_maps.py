"""Maps of many surveys that sampled the same places."""

import numpy as np
from scipy.spatial.distance import cdist

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.reconstruction.gp.selection.cells import Cell, FoundKernel, blocks, solved


def mapped(
    xy: FloatArray, heights: FloatArray, found: list[FoundKernel], nodes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the maps of B surveys of the same places, surveys with the same kernel factorized once.

    Parameters
    ----------
    xy, heights : (N, 2) and (N, B) ndarray
        Places and measured heights [m].
    found : list of FoundKernel
        One for each survey.
    nodes : (M, 2) ndarray
        Where the terrain is wanted [m].

    Returns
    -------
    mean : (M, B) ndarray
        Most likely heights [m], the constant mean by generalised least squares.
    rmse_m : (B,) ndarray
        Root mean square of the standard deviation over every ninth node: what the map says it errs.
    """
    mean, claimed = np.empty((len(nodes), heights.shape[1])), np.empty(heights.shape[1])
    for cell in dict.fromkeys(one.cell for one in found):
        mine = [b for b, one in enumerate(found) if one.cell == cell]
        mean[:, mine], share = _mapped_alike(xy, heights[:, mine], cell, nodes)
        claimed[mine] = np.sqrt(share * np.array([found[b].variance_m2 for b in mine]))
    return mean, claimed


def _mapped_alike(
    xy: FloatArray, heights: FloatArray, cell: Cell, nodes: FloatArray
) -> tuple[FloatArray, float]:
    """Return the maps (M, B) of surveys with one kernel, and the mean share of the variance that is left."""
    factor = cell.factor(xy)
    if factor is None:
        raise InputError("the covariance of the samples is singular; take them farther apart.")
    half = solved(factor, np.column_stack([np.ones(len(xy)), heights]))
    ones, rest = half[:, 0], half[:, 1:]
    centre = ones @ rest / (ones @ ones)
    weights = solved(factor, rest - np.outer(ones, centre), transposed=True)
    mean = np.empty((len(nodes), heights.shape[1]))
    for rows in blocks(len(nodes)):
        mean[rows] = centre + cell.correlation(cdist(nodes[rows], xy, "sqeuclidean")) @ weights
    explained = solved(factor, cell.correlation(cdist(xy, nodes[::9], "sqeuclidean")))
    gap = 1.0 - ones @ explained
    left = 1.0 - np.square(explained).sum(axis=0) + np.square(gap) / (ones @ ones)
    return mean, float(np.maximum(left, 0.0).mean())
