"""Slopes over a base and their covariance, from the joint estimate."""

import numpy as np
import pytest

from survey import Grid
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.solution import JointSolution
from tests.survey.reconstruction.joint.test_landmark_errors import landmarks, well_known_path

BASE_M = 6.0
PLACES = np.array([[30.0, 40.0], [60.0, 55.0], [90.0, 10.0]])


def solved(nugget_m: float = 0.0) -> JointSolution:
    config = GaussianProcessConfig(
        fit=False, variance_m2=4.0, length_scale_m=30.0, mean="plane", nugget_m=nugget_m
    )
    joint = JointConfig(landmark_shared_sigma_m=0.0)
    bounds = Grid((0.0, 0.0, 120.0, 80.0), 4.0).bounds
    return JointTerrain(well_known_path(), None, config, joint).solve(landmarks(1), bounds)


def test_slopes_are_differences_of_the_heights_of_the_map():
    solution = solved()
    rises, _ = solution.slopes(PLACES, BASE_M)
    for axis, step in enumerate(0.5 * BASE_M * np.eye(2)):
        difference = solution.terrain.height(PLACES + step) - solution.terrain.height(PLACES - step)
        np.testing.assert_allclose(rises[:, axis], difference / BASE_M, rtol=1e-9)


def test_the_covariance_of_slopes_is_that_of_the_heights_they_are_made_of():
    solution = solved()
    _, covariance = solution.slopes(PLACES, BASE_M)
    for k, place in enumerate(PLACES):
        ends = np.vstack([place + s * step for step in 0.5 * BASE_M * np.eye(2) for s in (1.0, -1.0)])
        heights = solution.terrain.covariance(ends) - solution.tail_m2 * np.eye(4)
        rise = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]]) / BASE_M
        expected = rise @ heights @ rise.T
        # The waves that the map leaves out add less than their variance.
        assert (np.diag(covariance[k]) >= np.diag(expected) - 1e-9).all()
        assert (np.diag(covariance[k]) <= np.diag(expected) + 2.0 * solution.tail_m2 / BASE_M**2 + 1e-9).all()
        assert covariance[k, 0, 1] == pytest.approx(expected[0, 1], abs=1e-9)


def test_a_nugget_makes_slopes_uncertain():
    _, bare = solved().slopes(PLACES, BASE_M)
    _, rough = solved(0.1).slopes(PLACES, BASE_M)
    added = np.einsum("mii->mi", rough - bare)
    assert (added >= 2.0 * 0.1**2 / BASE_M**2 - 1e-6).all()
