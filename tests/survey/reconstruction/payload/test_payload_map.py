"""Payload maps: lag, elevation as covariate, known answers, honest standard deviation, files with units."""

import numpy as np
import pytest
import rasterio

from survey import Dem, Grid, InputError, Reconstruction
from survey.core.crs import projected_crs
from survey.data.sensors.payload import PayloadLog, Quantity
from survey.data.trajectory import Trajectory
from survey.reconstruction.gp.kernels import Matern52
from survey.reconstruction.payload import (
    MOST_NODES,
    AveragedReadings,
    PayloadHyperparameters,
    lag_response,
    map_payload,
    payload_grid,
    write_payload,
)

CRS = projected_crs("EPSG:32608", "the test")
GRID = Grid((0.0, 0.0, 200.0, 200.0), 10.0, CRS)
WARM = Quantity(name="air_temperature", unit="degC", standard_name="air_temperature", noise_sd=0.05)


def terrain() -> Dem:
    x, y = np.meshgrid(GRID.x, GRID.y)
    return Dem.on(GRID, 0.2 * x + 5.0 * np.sin(y / 30.0))


def drive(n_swaths: int = 5, speed_m_s: float = 1.0) -> Trajectory:
    """Back and forth along the easting, one pose a second."""
    corners = [
        (x, y)
        for k, y in enumerate(np.linspace(10.0, 190.0, n_swaths))
        for x in ((0.0, 200.0) if k % 2 == 0 else (200.0, 0.0))
    ]
    ends = np.r_[0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T))]
    at = np.arange(0.0, ends[-1], speed_m_s)
    xy = np.column_stack([np.interp(at, ends, axis) for axis in np.array(corners).T])
    n = len(at)
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    return Trajectory(np.arange(n) * 1.0, np.column_stack([xy, np.zeros(n)]), turn, np.zeros((n, 3, 3)), CRS)


def field(xy: np.ndarray, height_m: np.ndarray) -> np.ndarray:
    return -3.0 - 0.05 * height_m + np.sin(xy[:, 0] / 60.0) * np.cos(xy[:, 1] / 50.0)


def log(quantity: Quantity = WARM, seed: int = 1) -> PayloadLog:
    path, ground = drive(), terrain()
    value = field(path.position[:, :2], ground.at(path.position[:, :2]))
    if quantity.lag_s:
        value = np.r_[value[0], lag_response(np.ones(len(value)), quantity.lag_s) @ value][:-1]
    noise = quantity.noise_sd * np.random.default_rng(seed).standard_normal(len(value))
    return PayloadLog(quantity, value + noise, path.time_s)


@pytest.fixture(scope="module")
def mapped() -> Reconstruction:
    return map_payload([log()], [drive()], terrain(), GRID)


def error_of(mapped: Reconstruction) -> np.ndarray:
    return mapped.mean.elevation.ravel() - field(GRID.xy, terrain().at(GRID.xy))


def test_a_field_on_the_terrain_is_mapped_within_its_standard_deviation(mapped):
    error, std = error_of(mapped), mapped.std.elevation.ravel()
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.mean(np.abs(error) <= 1.96 * std) > 0.9
    assert mapped.quantity == "air_temperature_degC"
    assert mapped.hyperparameters["noise_sd"] == pytest.approx(0.05, rel=0.15)
    assert mapped.hyperparameters["per_km_of_elevation"] == pytest.approx(-50.0, abs=15.0)


def test_a_lag_that_is_stated_does_not_shift_the_map():
    slow = WARM.model_copy(update={"lag_s": 15.0})
    readings = log(slow)
    with_lag = map_payload([readings], [drive()], terrain(), GRID)
    ignored = PayloadLog(WARM, readings.value, readings.time_s)
    without = map_payload([ignored], [drive()], terrain(), GRID)
    assert np.std(error_of(with_lag)) < 0.7 * np.std(error_of(without))


def test_two_drives_with_places_are_mapped_like_one_with_times(mapped):
    placed = log().placed(drive())
    half = len(placed) // 2
    parts = [
        PayloadLog(WARM, placed.value[part], None, placed.xy[part])
        for part in (slice(None, half), slice(half, None))
    ]
    again = map_payload(parts, [None, None], terrain(), GRID)
    np.testing.assert_allclose(again.mean.elevation, mapped.mean.elevation, atol=0.05)


def test_known_hyperparameters_are_used():
    known = PayloadHyperparameters(Matern52(1.0, 80.0), 0.05)
    result = map_payload([log()], [drive()], terrain(), GRID, hyperparameters=known)
    assert result.hyperparameters["length_scale_m"] == 80.0


def test_an_unknown_elevation_widens_the_standard_deviation(mapped):
    unsure = Dem.on(GRID, np.full(GRID.shape, 20.0))
    wide = map_payload([log()], [drive()], terrain(), GRID, terrain_std=unsure)
    assert (wide.std.elevation > mapped.std.elevation).all()


def test_averages_keep_every_reading():
    averaged = AveragedReadings.of([log().placed(drive())], 100)
    assert averaged.n_readings.sum() == len(log())
    assert len(averaged.value) <= 100


def test_files_carry_unit_and_standard_name(mapped, tmp_path):
    write_payload(mapped, log(), tmp_path)
    with rasterio.open(tmp_path / "dem.tif") as raster:
        assert raster.descriptions[0] == "air_temperature"
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(tmp_path / "air_temperature.nc", engine="h5netcdf") as data:
        assert data["air_temperature"].attrs["units"] == "degC"
        assert data["air_temperature"].attrs["standard_name"] == "air_temperature"
        assert data["standard_deviation"].attrs["units"] == "degC"
        np.testing.assert_allclose(data["air_temperature"].values, mapped.mean.elevation, rtol=1e-5)


def test_a_large_map_is_made_on_a_coarser_grid():
    fine = Grid((0.0, 0.0, 600.0, 600.0), 1.0, CRS)
    coarse = payload_grid(fine)
    assert np.prod(coarse.shape) <= MOST_NODES * 1.05
    assert coarse.bounds == fine.bounds
    assert payload_grid(GRID) is GRID


def test_logs_are_written_and_read_back(tmp_path):
    given = log().placed(drive())
    given.write(tmp_path / "log.csv")
    assert PayloadLog.read(tmp_path / "log.csv", WARM) == given


def test_readings_that_cannot_be_placed_are_refused(tmp_path):
    readings = log()
    with pytest.raises(InputError, match="no places"):
        readings.placed(None)
    late = PayloadLog(WARM, readings.value, readings.time_s + 1e6)
    with pytest.raises(InputError, match="fall into the drive"):
        late.placed(drive())
    with pytest.raises(InputError, match="neither times nor places"):
        PayloadLog(WARM, readings.value)
    with pytest.raises(InputError, match="lags"):
        PayloadLog(WARM.model_copy(update={"lag_s": 5.0}), readings.value, None, np.zeros((len(readings), 2)))
    (tmp_path / "log.csv").write_text("time_s,humidity\n0,1\n")
    with pytest.raises(InputError, match="air_temperature"):
        PayloadLog.read(tmp_path / "log.csv", WARM)
    afar = PayloadLog(WARM, readings.value, None, np.full((len(readings), 2), 1e7))
    with pytest.raises(InputError, match="lie on the terrain"):
        map_payload([afar], [None], terrain(), GRID)
