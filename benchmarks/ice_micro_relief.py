"""Micro-relief of bare ice: measured profiles beside generated ones, and the fit behind the generator.

Needs the folder `greenland_s5_uav_icesat2` of real data (FIRNLINE_DATA, by default ../shared/data beside
the checkout): drone profiles near station S5, Greenland (van Tiggelen et al., 2021, The Cryosphere 15, 2601).
"""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.signal import butter, sosfiltfilt
from scipy.special import gammaln
from scipy.stats import skew

from benchmarks.report import Row, main
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.grid import Grid
from survey.terrain import ice_micro_relief
from survey.terrain.synthetic import (
    ACROSS_CRESTS_M,
    ALONG_CRESTS_M,
    CREST_AZIMUTH_DEG,
    LONGEST_WAVE_M,
    MEASURED_SD_M,
)

AZIMUTHS_DEG = (90, 120, 150, 186)
_FOLDER = "greenland_s5_uav_icesat2"
_DEFAULT = Path(__file__).resolve().parents[2] / "shared" / "data"
# Waves of the fit: from the first Fourier wave clear of the high-pass down to four nodes.
_FIT_WAVES_M = (4.0, 29.0)


class Statistics(NamedTuple):
    """What is compared of one profile after the 35 m high-pass."""

    sd_m: float
    slope_sd: float
    skewness: float
    first_zero_m: float
    lowest_correlation: float


UNITS = ("m", "1", "1", "m", "1")


def read_profiles(folder: Path, kind: str = "") -> FloatArray:
    """Heights (4, 200) [m] at steps of 1 m, by direction; `kind` is empty (raw) or ``filtered``."""
    name = f"UAV_elev{kind}profiles1m_S5_20190906.txt"
    columns: FloatArray = np.genfromtxt(folder / "Fig2" / name, delimiter=",", skip_header=1)
    return np.ascontiguousarray(columns[:, 1:].T)


def high_passed(profiles: FloatArray) -> FloatArray:
    """Take away what is longer than 35 m, without moving the rest (the published filter is not stated)."""
    sections = butter(8, 1.0 / LONGEST_WAVE_M, "highpass", fs=1.0, output="sos")
    filtered: FloatArray = sosfiltfilt(sections, profiles, axis=-1)
    return filtered


def statistics(profile: FloatArray) -> Statistics:
    """Describe one high-passed profile with steps of 1 m."""
    z = profile - profile.mean()
    lags = range(30)
    correlation = np.array([np.mean(z[: len(z) - lag] * z[lag:]) for lag in lags]) / np.mean(z**2)
    return Statistics(
        float(z.std()),
        float(np.diff(z).std()),
        float(skew(z)),
        float(np.argmax(correlation < 0.0)),
        float(correlation.min()),
    )


def generated(azimuth_deg: int, n_fields: int) -> FloatArray:
    """Profiles (N, 200) through drawn micro-relief in one direction, 40 m apart.

    The relief is turned instead of the line, so that profiles run along rows and nothing is interpolated.
    """
    crests_deg = CREST_AZIMUTH_DEG + 90.0 - azimuth_deg
    grid = Grid((0.0, 0.0, 199.0, 1000.0), 1.0)
    fields = [
        ice_micro_relief(grid, stream(1, "micro-relief", azimuth_deg, n), crest_azimuth_deg=crests_deg)
        for n in range(n_fields)
    ]
    return np.vstack([field[::40] for field in fields])


class Fit(NamedTuple):
    """An anisotropic Matérn field fitted to profiles."""

    sd_m: float
    along_m: float
    across_m: float
    crest_azimuth_deg: float
    smoothness: float
    log_likelihood: float


def fitted(profiles: FloatArray, *, isotropic: bool = False, smoothness: float | None = None) -> Fit:
    """Maximise Whittle's likelihood of the profiles' spectra over the waves of the fit."""
    n = profiles.shape[1]
    window = np.hanning(n) / np.sqrt(np.mean(np.hanning(n) ** 2))
    frequency: FloatArray = np.arange(n // 2 + 1) / n
    centred = profiles - profiles.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(centred * window)) ** 2 / n
    used = (frequency > 1.0 / _FIT_WAVES_M[1]) & (frequency <= 1.0 / _FIT_WAVES_M[0])

    def unpacked(p: FloatArray) -> tuple[float, float, float, float, float]:
        elongation, turn = (1.0, 0.0) if isotropic else (float(np.exp(p[2])), float(p[3]))
        nu = float(np.exp(p[4])) if smoothness is None else smoothness
        return float(np.exp(p[0])), float(np.exp(p[1])), elongation, turn, nu

    def misfit(p: FloatArray) -> float:
        sd, across, elongation, crest, nu = unpacked(p)
        total = 0.0
        for azimuth, found in zip(np.radians(AZIMUTHS_DEG), power, strict=True):
            turn = azimuth - crest
            length = across / np.hypot(np.cos(turn) / elongation, np.sin(turn))
            expected = matern_profile_spectrum(frequency[used], sd, length, nu)
            total += float((np.log(expected) + found[used] / expected).sum())
        # The Hann window makes neighbouring waves alike: two thirds of them count.
        return total / 1.5

    starts = [[np.log(0.5), np.log(6.0), np.log(2.0), np.radians(a), np.log(1.5)] for a in (0.0, 60.0, 120.0)]
    results = [
        minimize(
            misfit,
            np.array(start),
            method="Nelder-Mead",
            options={"maxiter": 8000, "maxfev": 8000, "xatol": 1e-5, "fatol": 1e-6},
        )
        for start in starts
    ]
    best = min(results, key=lambda result: float(result.fun))
    sd, across, elongation, crest, nu = unpacked(best.x)
    along = across * elongation
    if along < across:
        along, across, crest = across, along, crest + np.pi / 2.0
    return Fit(sd, along, across, float(np.degrees(crest) % 180.0), nu, -float(best.fun))


def matern_profile_spectrum(frequency: FloatArray, sd_m: float, length_m: float, nu: float) -> FloatArray:
    """Two-sided spectral density [m³] of a line through a Matérn field at frequencies [1/m]."""
    a2 = 2.0 * nu / length_m**2
    factor = 2.0 * np.sqrt(np.pi) * np.exp(gammaln(nu + 0.5) - gammaln(nu)) * a2**nu
    density: FloatArray = sd_m**2 * factor * (a2 + (2.0 * np.pi * frequency) ** 2) ** (-nu - 0.5)
    return density


def measure(quick: bool) -> Iterator[Row]:
    """Print the measured numbers, ours beside them, and the fit."""
    folder = Path(os.environ.get("FIRNLINE_DATA", _DEFAULT)) / _FOLDER
    if not folder.is_dir():
        sys.exit(f"the folder of real data {folder} is not here; set FIRNLINE_DATA.")
    profiles, published = high_passed(read_profiles(folder)), read_profiles(folder, "filtered")
    for azimuth, profile, stated in zip(AZIMUTHS_DEG, profiles, published, strict=True):
        yield Row(f"{azimuth}° sd as published", float(stated.std()), "m")
        found = statistics(profile)
        drawn = np.array([statistics(p) for p in high_passed(generated(azimuth, 4 if quick else 16))])
        for name, value, unit, ours in zip(Statistics._fields, found, UNITS, drawn.T, strict=True):
            rank = float(np.mean(ours < value) + 0.5 * np.mean(ours == value))
            yield Row(f"{azimuth}° {name} measured", value, unit)
            yield Row(f"{azimuth}° {name} generated, median", float(np.median(ours)), unit)
            yield Row.of(
                f"{azimuth}° {name}: distance of the rank from 1/2", abs(rank - 0.5), "1", "<=", 0.495
            )
    yield from _fit_rows(published)


def _fit_rows(profiles: FloatArray) -> Iterator[Row]:
    fit, free = fitted(profiles, smoothness=1.5), fitted(profiles)
    isotropic = fitted(profiles, isotropic=True)
    yield Row("fit: sd with all long waves", fit.sd_m, "m")
    yield Row("generator: sd of waves under 35 m", MEASURED_SD_M, "m")
    for name, value, kept in (
        ("length along crests", fit.along_m, ALONG_CRESTS_M),
        ("length across crests", fit.across_m, ACROSS_CRESTS_M),
        ("crest azimuth", fit.crest_azimuth_deg, CREST_AZIMUTH_DEG),
    ):
        unit = "deg" if "azimuth" in name else "m"
        yield Row(f"fit: {name}", value, unit)
        yield Row.of(
            f"fit: {name}, relative distance from the code", abs(value / kept - 1.0), "1", "<=", 0.02
        )
    yield Row("fit: smoothness when free", free.smoothness, "1")
    gain = free.log_likelihood - isotropic.log_likelihood
    yield Row.of("fit: log-likelihood won by anisotropy", gain, "1", ">=", 3.0)


if __name__ == "__main__":
    main("Ice micro-relief", measure)
