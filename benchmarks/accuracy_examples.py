"""Published worked examples of the accuracy standards: what we compute, what is printed, and to how many digits."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from survey.core.lengths import FOOT_M
from survey.scoring.accuracy import ErrorStatistics
from survey.scoring.standards.checkpoint_errors import rmse_factors
from survey.scoring.standards.map_classes import map_classes
from survey.scoring.standards.standards import (
    CONTOURS,
    SPOT_HEIGHTS,
    accuracy_r,
    accuracy_z,
    asprs_1990_horizontal_limit_m,
    checkpoints_2014,
    cmas,
    equivalent_intervals_m,
    nmas_horizontal_limit_m,
    nva_limit_m,
    rmse_h,
    rmse_v,
    vva_limit_m,
)


class Example(NamedTuple):
    """One number: ours, the printed one, and half a unit of its last printed digit."""

    name: str
    ours: float
    printed: float
    tolerance: float

    @property
    def holds(self) -> bool:
        """Ours rounds to the printed number; the hair is for numbers that end in a five."""
        return abs(self.ours - self.printed) <= self.tolerance + 1e-9


# W1: Table 7.4 of Edition 2 [cm], checkpoints accurate to 2 cm.
_TABLE_7_4 = {
    1.00: 2.24, 1.50: 2.50, 2.00: 2.83, 2.50: 3.20, 3.00: 3.61, 3.50: 4.03, 4.00: 4.47, 4.50: 4.92,
    5.00: 5.39, 5.50: 5.85, 6.00: 6.32, 6.50: 6.80, 7.00: 7.28, 7.50: 7.76, 8.00: 8.25, 8.50: 8.73,
    9.00: 9.22, 9.50: 9.71, 10.00: 10.20,
}  # fmt: skip
# W2: map and survey coordinates of five points.
_MAP = np.array([
    (359584.394, 5142449.934, 477.127), (359872.190, 5147939.180, 412.406), (359893.089, 5136979.824, 487.292),
    (359927.194, 5151084.129, 393.591), (372737.074, 5151675.999, 451.305),
])  # fmt: skip
_SURVEY = np.array([
    (359584.534, 5142450.004, 477.198), (359872.290, 5147939.280, 412.396), (359893.072, 5136979.894, 487.190),
    (359927.264, 5151083.979, 393.691), (372736.944, 5151675.879, 451.218),
])  # fmt: skip
_MEAN, _STD, _RMSE = (-0.033, 0.006, 0.006), (0.108, 0.119, 0.091), (0.102, 0.106, 0.081)
# Classes of 2014 [cm]: RMSE_z, NVA, VVA, contour interval of 1990 class 1 and 2, and of NMAS.
_CLASSES_2014 = (
    (1.0, 2.0, 3.0, 3.0, 1.5, 3.29), (2.5, 4.9, 7.5, 7.5, 3.8, 8.22), (5.0, 9.8, 15.0, 15.0, 7.5, 16.45),
    (10.0, 19.6, 30.0, 30.0, 15.0, 32.90), (15.0, 29.4, 45.0, 45.0, 22.5, 49.35), (20.0, 39.2, 60.0, 60.0, 30.0, 65.80),
    (33.3, 65.3, 100.0, 99.9, 50.0, 109.55), (66.7, 130.7, 200.0, 200.1, 100.1, 219.43),
    (100.0, 196.0, 300.0, 300.0, 150.0, 328.98), (333.3, 653.3, 1000.0, 999.9, 500.0, 1096.49),
)  # fmt: skip
_COUNTS_2014 = {500: (20, 5), 750: (20, 10), 1000: (25, 15), 1250: (30, 20), 1500: (35, 25), 1750: (40, 30),
                2000: (45, 35), 2250: (50, 40), 2500: (55, 45)}  # fmt: skip
# Limits of 1990 [m] for classes 1 to 3 by interval [ft]: contours and spot heights.
_LIMITS_1990 = {
    1: ((0.1016, 0.2032, 0.3048), (0.0508, 0.1016, 0.1524)),
    2: ((0.2032, 0.4064, 0.6096), (0.1016, 0.2032, 0.3048)),
    3: ((0.3048, 0.6096, 0.9144), (0.1524, 0.3048, 0.4572)),
}
_HORIZONTAL_1990 = {50: 0.0125, 100: 0.025, 200: 0.05, 500: 0.125, 1000: 0.25, 2000: 0.5, 4000: 1.0, 5000: 1.25,
                    10_000: 2.5, 20_000: 5.0}  # fmt: skip
# Interval factors of an RMSE by the number of checkpoints.
_FACTORS = {5: (0.6242, 2.4526), 10: (0.6987, 1.7549), 20: (0.7651, 1.4441), 30: (0.7991, 1.3367),
            50: (0.8367, 1.2431), 100: (0.8785, 1.1607), 120: (0.8879, 1.1447)}  # fmt: skip
# Tables I to III of the glacier paper [m].
_PAPER = {
    "Class 1": ((0.3048, 0.0508), (0.6096, 0.1016), (0.9144, 0.1524)),
    "Class 2": ((0.6096, 0.1016), (1.2192, 0.2032), (1.8288, 0.3048)),
    "Class 3": ((0.9144, 0.1524), (1.8288, 0.3048), (2.7432, 0.4572)),
}


def examples() -> Iterator[Example]:
    """Yield every worked example that can be computed without data."""
    for fit, printed in _TABLE_7_4.items():
        yield Example(f"Edition 2, Table 7.4, {fit} cm", rmse_v(fit, 2.0), printed, 0.005)
    yield from five_points(_MAP - _SURVEY, "from coordinates")
    yield from _single()
    yield from _tables()


def _single() -> Iterator[Example]:
    """W3 to W8, W11 to W13."""
    rmse = math.hypot(0.062, 0.118)
    yield Example("W3 RMSE", rmse, 0.1333, 5e-5)
    yield Example("W3 accuracy", accuracy_z(rmse), 0.261, 5e-4)
    yield Example("W3 accuracy without bias", accuracy_z(0.118), 0.231, 5e-4)
    yield Example("W5 Baltimore", accuracy_r(12.9 / math.sqrt(2.0), 12.9 / math.sqrt(2.0)) or 0.0, 22.3, 0.05)
    for scale_ft, printed in ((20, 0.43), (50, 1.10), (100, 2.10)):
        # The source prints two digits of it, coarsely rounded.
        limit = scale_ft / 100.0
        yield Example(f"W6 CMAS at 1 inch = {scale_ft} ft", cmas(limit, limit), printed, 0.05)
    for limit, printed in (
        (0.20, 0.60),
        (0.50, 1.50),
        (1.00, 3.00),
        (0.30, 0.90),
        (0.60, 1.80),
        (1.50, 4.50),
    ):
        yield Example("W6 maximum error", 3.0 * limit, printed, 0.005)
    yield Example("W7 class 1 interval", equivalent_intervals_m(0.09)["asprs-1990 class 1"], 0.27, 0.005)
    yield Example("W8 NMAS 1:24,000", nmas_horizontal_limit_m(24_000), 12.2, 0.05)
    yield Example("W8 NMAS 1:24,000, feet", nmas_horizontal_limit_m(24_000) / FOOT_M, 40.0, 0.5)
    yield Example("W8 NMAS 1:12,000", nmas_horizontal_limit_m(12_000), 10.2, 0.05)
    yield Example("W11 RMSE_H", rmse_h(4.0, 3.0, 1.0), 5.196, 5e-4)
    yield Example("W11 RMSE_V", rmse_v(1.0, 2.0), 2.236, 5e-4)
    yield Example("W12 points for 12,950 km2", float(sum(checkpoints_2014(12_950.0))), 205.0, 0.0)
    yield Example("W13 unequal axes", accuracy_r(0.6, 1.0) or 0.0, 1.9582, 5e-5)


def _tables() -> Iterator[Example]:
    for rmse, nva, vva, class_1, class_2, nmas in _CLASSES_2014:
        found = equivalent_intervals_m(rmse)
        yield Example(f"2014, {rmse} cm, NVA", nva_limit_m(rmse), nva, 0.05)
        # The rows of thirds are printed for 33.33…, 66.66… and 333.33… cm.
        yield Example(f"2014, {rmse} cm, VVA", vva_limit_m(rmse), vva, 0.1)
        yield Example(f"2014, {rmse} cm, class 1 interval", found["asprs-1990 class 1"], class_1, 0.05)
        yield Example(f"2014, {rmse} cm, class 2 interval", found["asprs-1990 class 2"], class_2, 0.05)
        yield Example(f"2014, {rmse} cm, NMAS interval", found["nmas"], nmas, 0.005)
    for area, counts in _COUNTS_2014.items():
        for ours, printed in zip(checkpoints_2014(float(area)), counts, strict=True):
            yield Example(f"2014, points for {area} km2", float(ours), float(printed), 0.0)
    for standard, column in ((CONTOURS, 0), (SPOT_HEIGHTS, 1)):
        limits = {(r.map_class, round(r.interval_m / FOOT_M)): r.limit_m for r in map_classes(standard)}
        for feet, printed_rows in _LIMITS_1990.items():
            for k, printed in enumerate(printed_rows[column], start=1):
                yield Example(f"{standard}, class {k}, {feet} ft", limits[f"Class {k}", feet], printed, 5e-5)
    for scale, printed in _HORIZONTAL_1990.items():
        yield Example(f"1990, horizontal, 1:{scale}", asprs_1990_horizontal_limit_m(scale), printed, 5e-5)
    for n, printed_pair in _FACTORS.items():
        for ours, printed in zip(rmse_factors(n), printed_pair, strict=True):
            yield Example(f"RMSE interval, n = {n}", ours, printed, 5e-5)


def paper_tables() -> Iterator[Example]:
    """Yield Tables I to III of the glacier paper."""
    ours = {(row.map_class, round(row.interval_m, 4)): row.limit_m for row in map_classes()}
    for name, rows in _PAPER.items():
        for interval, printed in rows:
            yield Example(f"{name}, {interval} m", ours.get((name, interval), math.nan), printed, 5e-5)


def five_points(errors: np.ndarray, source: str) -> Iterator[Example]:
    """Yield the statistics of the five-point example of 2014, recalled and not opened; its standard deviation divides by n - 1."""
    found = [ErrorStatistics.of(column) for column in errors.T]
    for axis, statistics in zip("ENz", found, strict=True):
        k = "ENz".index(axis)
        yield Example(f"W2 {source}, mean {axis}", statistics.bias_m, _MEAN[k], 5e-4)
        yield Example(f"W2 {source}, std {axis}", statistics.std_m * math.sqrt(5 / 4), _STD[k], 5e-4)
        yield Example(f"W2 {source}, RMSE {axis}", statistics.rmse_m, _RMSE[k], 5e-4)
    x, y, z = (statistics.rmse_m for statistics in found)
    yield Example(f"W2 {source}, RMSE_r", math.hypot(x, y), 0.147, 5e-4)
    yield Example(f"W2 {source}, horizontal 95 %", accuracy_r(x, y) or 0.0, 0.255, 5e-4)
    yield Example(f"W2 {source}, vertical 95 %", accuracy_z(z), 0.160, 5e-4)


def stored_examples(data: Path) -> Iterator[Example]:
    """Yield what the data folder holds: the five points as residuals, and another tool's statistics of a raster."""
    case = json.loads((data / "stats_asprs_nssda_examples" / "examples.json").read_text())[
        "asprs_2014_annexD_5pt"
    ]
    residuals = np.column_stack([case[name] for name in ("residual_x", "residual_y", "residual_z")])
    yield from five_points(residuals, "stored")
    yield from _demcompare(data / "stats_demcompare_srtm" / "gironde_global")


def _demcompare(folder: Path) -> Iterator[Example]:
    import csv

    import rasterio

    with (folder / "stats_results.csv").open() as file:
        theirs = next(csv.DictReader(file))
    with rasterio.open(folder / "dem_for_stats.tif") as source:
        errors = source.read(1, masked=True).astype(np.float64).compressed()
    errors = errors[np.isfinite(errors)]
    ours = ErrorStatistics.of(errors)
    found = {
        "nbpts": float(ours.n),
        "mean": ours.bias_m,
        "median": ours.median_m,
        "rmse": ours.rmse_m,
        "std": ours.std_m,
        "nmad": ours.nmad_m,
        "max": float(errors.max()),
        "min": float(errors.min()),
        # About the mean, as that tool takes it.
        "percentil_90": float(np.percentile(np.abs(errors - errors.mean()), 90.0)),
    }
    for name, value in found.items():
        yield Example(f"demcompare, {name}", value, float(theirs[name]), 5e-6)
