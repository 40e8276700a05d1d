"""The generated relief of bare ice is like the measured one."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.grid import Grid
from survey.terrain import ice_micro_relief
from survey.terrain.synthetic import CREST_AZIMUTH_DEG, LONGEST_WAVE_M, MEASURED_SD_M

AZIMUTHS_DEG = (90, 120, 150, 186)


def described(profiles: FloatArray) -> FloatArray:
    """High-pass at 35 m; sd [m], sd of the slope, first zero [m] and minimum of the correlation (N, 4)."""
    sections = butter(8, 1.0 / LONGEST_WAVE_M, "highpass", fs=1.0, output="sos")
    rows = []
    for profile in sosfiltfilt(sections, profiles, axis=-1):
        z = profile - profile.mean()
        correlation = np.array([np.mean(z[: len(z) - lag] * z[lag:]) for lag in range(30)]) / np.mean(z**2)
        rows.append([z.std(), np.diff(z).std(), np.argmax(correlation < 0.0), correlation.min()])
    return np.array(rows, dtype=np.float64)


@pytest.fixture(scope="module")
def generated() -> dict[int, FloatArray]:
    """52 profiles of 200 m in each measured direction: the relief is turned, so that they run along rows."""
    grid = Grid((0.0, 0.0, 199.0, 1000.0), 1.0)
    rng = np.random.default_rng(12)
    return {
        azimuth: described(
            np.vstack(
                [
                    ice_micro_relief(grid, rng, crest_azimuth_deg=CREST_AZIMUTH_DEG + 90.0 - azimuth)[::40]
                    for _ in range(2)
                ]
            )
        )
        for azimuth in AZIMUTHS_DEG
    }


def test_it_is_like_the_published_profiles(real_data: Path, generated: dict[int, FloatArray]) -> None:
    file = real_data / "greenland_s5_uav_icesat2" / "Fig2" / "UAV_elevprofiles1m_S5_20190906.txt"
    measured = described(np.genfromtxt(file, delimiter=",", skip_header=1)[:, 1:].T)
    for azimuth, found in zip(AZIMUTHS_DEG, measured, strict=True):
        ours = generated[azimuth]
        # Each measured profile could be one of 52 drawn in its direction.
        assert (found >= ours.min(axis=0)).all(), azimuth
        assert (found <= ours.max(axis=0)).all(), azimuth
    typical = np.median(np.vstack(list(generated.values())), axis=0)
    assert (typical >= measured.min(axis=0)).all()
    assert (typical <= measured.max(axis=0)).all()


def test_standard_deviation_is_the_one_asked_for() -> None:
    heights = ice_micro_relief(Grid((0.0, 0.0, 800.0, 800.0), 2.0), np.random.default_rng(2), sd_m=0.3)
    # About (800 / 17)² = 2200 independent half waves: 0.3 / sqrt(2 * 2200) = 0.0045, times 4.
    assert heights.std() == pytest.approx(0.3, abs=4 * 0.0045)
    assert not ice_micro_relief(Grid((0.0, 0.0, 50.0, 50.0), 2.0), np.random.default_rng(2), sd_m=0.0).any()


def test_default_is_the_measured_one() -> None:
    # Fitted Matérn 3/2: sd 1.192 m with all waves, of whose variance 30.6 % are in waves under 35 m.
    assert abs(MEASURED_SD_M - 1.192 * 0.306**0.5) < 0.005


@pytest.mark.parametrize(("crest_azimuth_deg", "along"), [(0.0, (1, 0)), (90.0, (0, 1)), (45.0, (-1, 1))])
def test_crests_run_in_the_direction_asked_for(crest_azimuth_deg: float, along: tuple[int, int]) -> None:
    """Heights differ less along the crests (row, column; row 0 is north) than across."""
    z = ice_micro_relief(
        Grid((0.0, 0.0, 600.0, 600.0), 2.0), np.random.default_rng(3), crest_azimuth_deg=crest_azimuth_deg
    )
    row, column = along
    across = (-column, row)

    def difference(shift: tuple[int, int]) -> float:
        return float(np.mean((np.roll(z, shift, axis=(0, 1)) - z)[4:-4, 4:-4] ** 2))

    assert difference((2 * row, 2 * column)) < 0.5 * difference((2 * across[0], 2 * across[1]))


def test_no_wave_is_longer_than_35_m() -> None:
    grid = Grid((0.0, 0.0, 700.0, 700.0), 2.0)
    means = (
        ice_micro_relief(grid, np.random.default_rng(4))[:350, :350].reshape(5, 70, 5, 70).mean(axis=(1, 3))
    )
    # Over 140 m blocks, four of the longest waves, only what the edges cut is left: a few per cent.
    assert np.abs(means).max() < 0.05 * MEASURED_SD_M


def test_same_seed_same_bytes() -> None:
    grid = Grid((0.0, 0.0, 60.0, 60.0), 1.0)
    a, b = (ice_micro_relief(grid, np.random.default_rng(5)).tobytes() for _ in range(2))
    assert a == b


def test_refusals() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="standard deviation"):
        ice_micro_relief(Grid((0.0, 0.0, 60.0, 60.0), 1.0), rng, sd_m=-0.1)
    with pytest.raises(InputError, match="use a finer grid"):
        ice_micro_relief(Grid((0.0, 0.0, 600.0, 600.0), 10.0), rng)
