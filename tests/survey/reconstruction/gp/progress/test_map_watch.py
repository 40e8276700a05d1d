"""The expected time of a large map is stated before it is made."""

import logging
import re

import numpy as np

from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp import gp_terrain as map_watch
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain, MapWatch

GRID = Grid((0.0, 0.0, 100.0, 100.0), 1.0)
CONFIG = GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=30.0)


def fitted(n_points: int) -> None:
    xy = np.random.default_rng(1).uniform(0.0, 100.0, (n_points, 2))
    points = SurfacePoints(np.column_stack([xy, np.sin(xy[:, 0] / 20.0)]), sigma_m=0.1, crs=GRID.crs)
    GaussianProcessTerrain(CONFIG, bounds=GRID.bounds, watch=MapWatch(GRID)).fit(points)


def test_the_time_of_a_large_map_is_stated_for_every_engine(caplog, monkeypatch):
    monkeypatch.setattr(map_watch, "_N_LARGE", 5000)
    with caplog.at_level(logging.WARNING):
        for n_points in (100, 600):  # dense, and in Fourier waves
            fitted(n_points)
    texts = [record.getMessage() for record in caplog.records]
    assert len(texts) == 2
    assert all(re.fullmatch(r"a map of 10201 nodes takes about \d+ s", text) for text in texts)


def test_the_time_of_a_small_map_is_not_stated(caplog):
    with caplog.at_level(logging.WARNING):
        fitted(100)
    assert not caplog.records
