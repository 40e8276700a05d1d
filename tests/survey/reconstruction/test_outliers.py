"""Points that disagree with their neighbours are named, and count less when asked."""

import numpy as np

from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig, GaussianProcessTerrain
from survey.reconstruction.observations import Outliers


def test_the_worst_comes_first() -> None:
    found = Outliers.among(np.array([0.0, 5.0, -9.0, 3.9]), np.array([10, 11, 12, 13]))
    assert found.index.tolist() == [12, 11]
    assert found.facts()["n"] == 2


def test_a_blunder_is_reported_and_a_robust_map_forgets_it() -> None:
    rng = np.random.default_rng(0)
    xy = rng.uniform(0.0, 100.0, (200, 2))
    z = np.sin(xy[:, 0] / 20.0) + 0.05 * rng.standard_normal(200)
    z[17] += 4.0
    points = SurfacePoints(np.column_stack([xy, z]), sigma_m=0.05, crs="EPSG:32608")
    settings = {"fit": False, "variance_m2": 1.0, "length_scale_m": 25.0}
    plain = GaussianProcessTerrain(GaussianProcessConfig(**settings)).fit(points)
    robust = GaussianProcessTerrain(GaussianProcessConfig(**settings, robust=True)).fit(points)
    for model in (plain, robust):
        assert model.learned_ is not None
        facts = model.learned_.diagnostics()["outliers"]
        assert facts["rows"][0] == 17
        assert len(model.learned_.process.data) == 200
    place, height = xy[17:18], np.sin(xy[17, 0] / 20.0)
    assert abs(robust.predict(place)[0] - height) < 0.5 * abs(plain.predict(place)[0] - height)
