import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from survey import Dem, Grid, InputError
from survey.reconstruction.motion.priors import VelocityRasters, motion_from_rasters, motion_from_slope

CRS = "EPSG:32607"
GRID = Grid((0.0, 0.0, 3000.0, 3000.0), 120.0, CRS)


def rasters(sigma: float = 0.1) -> VelocityRasters:
    """Velocity of 0.5 m/day to the east that grows by 0.2 a kilometre to the north."""
    y = np.tile(GRID.y[:, None], (1, len(GRID.x)))
    flat = np.zeros(GRID.shape)
    return VelocityRasters(
        *(Dem.on(GRID, v) for v in (0.5 + 0.2 * (y - 1500.0) / 1000.0, flat, flat + sigma, flat + sigma))
    )


def test_rasters_state_a_plane_with_their_errors():
    motion = motion_from_rasters(
        rasters(), (1200.0, 1200.0, 1800.0, 1800.0), lowering_sigma=0.05, epoch_s=0.0
    )
    places = np.array([[1500.0, 1500.0], [1500.0, 2000.0]])
    np.testing.assert_allclose(motion.rates(places)[:, 0], [0.5, 0.6], atol=1e-9)
    np.testing.assert_allclose(motion.rates_sigma(places)[0], [0.1, 0.1, 0.05], atol=1e-6)


def test_rasters_without_known_cells_are_refused():
    with pytest.raises(InputError, match="0 known cells"):
        motion_from_rasters(rasters(), (9000.0, 9000.0, 9600.0, 9600.0), lowering_sigma=0.05, epoch_s=0.0)


def test_ice_flows_down_its_slope():
    dem = Dem.on(GRID, 0.1 * np.tile(GRID.x, (len(GRID.y), 1)))
    motion = motion_from_slope(dem, lowering_sigma=0.02, epoch_s=0.0)
    east, north, rise = motion.rates(np.array([[1500.0, 1500.0]]))[0]
    sigma = motion.rates_sigma(np.array([[1500.0, 1500.0]]))[0]
    assert -0.1 < east < 0.0
    assert abs(north) < 1e-9
    assert rise == 0.0
    assert sigma[0] == pytest.approx(3.0 * sigma[1])


def test_level_ice_has_no_direction():
    with pytest.raises(InputError, match="no slope"):
        motion_from_slope(Dem.on(GRID, np.zeros(GRID.shape)), lowering_sigma=0.02, epoch_s=0.0)


def test_measured_rasters_are_a_prior(real_data):
    folder = real_data / "ice_kaskawulsh_velocity"
    name = "LS8-061018_20180304-20180405"
    read = VelocityRasters(
        *(Dem.read(folder / f"{name}_{part}.tif") for part in ("vx", "vy", "errx", "erry"))
    )
    known = np.all([np.isfinite(raster.elevation) for raster in read], axis=0)
    speed = np.where(known, np.hypot(read.east.elevation, read.north.elevation), 0.0)
    # The fastest kilometre without gaps.
    mean = np.where(uniform_filter(known.astype(float), 9) > 0.999, uniform_filter(speed, 9), 0.0)
    x, y = read.east.xy[int(np.argmax(mean))]
    bounds = (x - 300.0, y - 300.0, x + 300.0, y + 300.0)
    motion = motion_from_rasters(read, bounds, lowering_sigma=0.05, epoch_s=0.0)
    rates, sigma = motion.rates(np.array([[x, y]]))[0], motion.rates_sigma(np.array([[x, y]]))[0]
    assert np.hypot(*rates[:2]) == pytest.approx(mean.max(), rel=0.5)
    assert (sigma[:2] < 0.5).all()
