import numpy as np
import pytest

from planners.prediction.assumptions import roughness_elsewhere


def test_ground_elsewhere_is_rougher_over_longer_lags_and_on_steeper_slopes():
    gentle, steep, far = (roughness_elsewhere(*of) for of in ((10.0, 0.05), (10.0, 0.5), (40.0, 0.5)))
    assert gentle.mean < steep.mean < far.mean
    assert gentle.variance == far.variance


def test_slopes_beyond_those_measured_count_as_the_nearest_of_them():
    for slope, nearest in ((0.0, 0.02), (3.0, 1.0)):
        assert roughness_elsewhere(10.0, slope).mean == pytest.approx(roughness_elsewhere(10.0, nearest).mean)
    assert np.exp(roughness_elsewhere(10.0, 1.0).mean) == pytest.approx(4.2)
