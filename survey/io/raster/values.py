"""Values of raster bands: scale, offset, units of length, and numbers that are no elevation.

Stored numbers become metres by the scale, offset and unit of the band. Depths, pictures, and numbers that often stand for
missing ones (such as -9999 or -32768) are refused. Cells without a height that a raster does not mark are found by the
gap between them and all others.
"""

import logging
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from survey.core import FloatArray, InputError
from survey.core.lengths import length_name, metres_in, named_units, same_length
from survey.core.transformation import WGS84, MetricCrs, metric_crs

_PICTURES = frozenset(
    [
        "palette", "red", "green", "blue", "alpha", "hue", "saturation", "lightness", "cyan", "magenta",
        "yellow", "black", "Y", "Cb", "Cr",
    ]
)  # fmt: skip
MARKS = (-9999.0, -32767.0, -32768.0, -99999.0)
"""Numbers that stand for an unknown one, whether or not they are declared as nodata."""
MARKS_IN_METRES = (9999.0, 32767.0, 65535.0, 99999.0)
"""Heights in metres that stand for an unknown one too: no ground on Earth is as high."""
# What no band holds.
LARGEST = 1e15


class BandScale(NamedTuple):
    """Stored numbers times `factor` plus `offset` are metres."""

    factor: float = 1.0
    offset: float = 0.0

    def applied(self, stored: FloatArray) -> FloatArray:
        """Return metres (h, w); numbers that are metres already come back bit by bit.

        `stored` (h, w): numbers as the file stores them. Returns (h, w): metres.
        """
        if self == (1.0, 0.0):
            return stored
        return stored * self.factor + self.offset


OWN_TAGS = "FIRNLINE_"
"""Beginning of the tags of rasters that firnline wrote, whose heights are in metres."""


def band_scale(source: Any, band: int, units: str | None = None) -> BandScale:
    """Return scale and offset of an open raster's band, the conversion of its unit to metres included.

    The unit is that of the band, else of the vertical CRS, else `units`.
    """
    metres = _unit_of_band(source, band) or _named_unit(source, band, units)
    scale, offset = float(source.scales[band - 1]), float(source.offsets[band - 1])
    if not (np.isfinite([scale, offset]).all() and scale != 0.0):
        raise InputError(
            f"band {band} of {source.name} has the scale {scale:g} and the offset {offset:g}; it is damaged, get it again."
        )
    return BandScale(scale * metres, offset * metres)


def _unit_of_band(source: Any, band: int) -> float | None:
    """Return the metres in the unit that a band or the vertical CRS states; None where neither does."""
    unit = (source.units[band - 1] or "").strip()
    of_crs = crs_of_raster(source).height_m
    if not unit:
        return of_crs
    metres = metres_in(unit)
    if metres is None:
        raise InputError(
            f"band {band} of {source.name} counts in {unit[:40]!r}; metres or a known unit of length were expected, convert it first."
        )
    if of_crs is not None and abs(metres - of_crs) > 1e-5:
        raise InputError(
            f"band {band} of {source.name} counts in {unit[:40]!r}, and the heights of its CRS in {length_name(of_crs)}; correct one of them "
            "(gdal_edit.py -units, or -a_srs)."
        )
    return of_crs or metres


def _named_unit(source: Any, band: int, units: str | None) -> float:
    """Return the metres in the unit of a band that states none."""
    if any(tag.startswith(OWN_TAGS) for tag in source.tags()):
        return 1.0
    if units is not None:
        return named_units(units)
    place_m = crs_of_raster(source).place_m
    if not same_length(place_m, 1.0):
        raise InputError(
            f"band {band} of {source.name} does not state the unit of its heights, and its places count in {length_name(place_m)}; name the unit "
            "of the heights with --units m, ft or us-ft, or in the file (gdal_edit.py -units)."
        )
    return 1.0


def crs_of_raster(source: Any) -> MetricCrs:
    """Return the CRS of an open raster in metres, with the metres in its units."""
    return _metric(source.crs.to_wkt() if source.crs else "")


@lru_cache(maxsize=64)
def _metric(wkt: str) -> MetricCrs:
    return metric_crs(wkt, "the raster") if wkt else MetricCrs(WGS84)


def valid_range(source: Any, band: int) -> tuple[float, float]:
    """Return the least and the greatest stored number that mean a known cell, as NetCDF states them.

    Returns: ``valid_range``, or ``valid_min`` and ``valid_max``; infinite where nothing is stated.
    """
    tags = source.tags(band)
    both = tags.get("valid_range", "").strip("{} ").split(",") if tags.get("valid_range") else []
    low, high = both if len(both) == 2 else (tags.get("valid_min", "-inf"), tags.get("valid_max", "inf"))
    try:
        return float(low), float(high)
    except ValueError as error:
        raise InputError(
            f"band {band} of {source.name} states the valid range {low[:20]!r} to {high[:20]!r}; numbers were expected, correct it."
        ) from error


def refuse_depths(source: Any, band: int) -> None:
    """Refuse a band that counts downwards."""
    if source.tags(band).get("positive", "").strip().lower() == "down":
        raise InputError(
            f"band {band} of {source.name} counts downwards (positive = down); elevations upwards are needed, change the sign first."
        )


def refuse_picture(source: Any, band: int) -> None:
    """Refuse a band of a picture or a mask of single bits: it is no elevation."""
    colour = source.colorinterp[band - 1].name
    if colour in _PICTURES:
        raise InputError(
            f"band {band} of {source.name} is a picture's {colour} band; a raster of elevations in metres was expected."
        )
    n_bits = source.tags(band, ns="IMAGE_STRUCTURE").get("NBITS") or source.tags(ns="IMAGE_STRUCTURE").get(
        "NBITS"
    )
    if n_bits == "1":
        raise InputError(
            f"band {band} of {source.name} has one bit per cell, so it is a mask; a raster of elevations in metres was expected, "
            "or save the mask as bytes."
        )


def refuse_unmarked(stored: FloatArray, name: str, dtype: str = "float64", *, in_metres: bool = True) -> None:
    """Refuse stored numbers (h, w) that mean an unknown cell without being declared as nodata.

    `stored` (h, w): numbers as the file stores them, NaN for nodata.
    """
    known = stored[np.isfinite(stored)]
    if len(known) == 0:
        return
    lowest, highest = float(known.min()), float(known.max())
    largest = max(-lowest, highest)
    marks = (*MARKS, *_extremes(dtype), *(MARKS_IN_METRES if in_metres else ()))
    found = next((mark for mark in marks if lowest <= mark <= highest and (known == mark).any()), None)
    if found is None and largest < LARGEST:
        return
    value = found if found is not None else (lowest if -lowest == largest else highest)
    raise InputError(
        f"{name} holds the number {value:g}, which is no elevation and not declared as nodata; declare it (gdal_edit.py -a_nodata {value:g})."
    )


def _extremes(dtype: str) -> tuple[float, ...]:
    """Return the numbers at the ends of an integer type of more than 8 bits; 0 is an elevation."""
    kind = np.dtype(dtype)
    if kind.kind not in "iu" or kind.itemsize == 1:
        return ()
    limits = np.iinfo(kind)
    return tuple(float(value) for value in (limits.min, limits.max) if value)


_LEAST_GAP_M = 100.0
_LEAST_CELLS = 2
LOWEST_M, HIGHEST_M = -12_000.0, 9_000.0
"""Heights between which all ground on Earth lies."""


def refuse_detached(elevation: FloatArray, step_m: float, name: str) -> None:
    """Refuse elevations whose lowest or highest number is repeated, and far from every other one.

    Collars and voids are often filled with a number such as 0 that the file does not declare. No ground is
    surrounded by nothing but cliffs that are higher than 100 m and steeper than 45 degrees.

    `elevation` (H, W): elevations [m], NaN where unknown. `step_m`: width of a cell [m].

    >>> ground = np.array([[812.0, 815.0, 0.0], [811.0, 814.0, 0.0]])
    >>> refuse_detached(ground, 10.0, "dem.tif")
    Traceback (most recent call last):
    survey.core.errors.InputError: dem.tif holds 2 cells of exactly 0 m, and all others are 811 m or more...
    """
    extremes = Extremes()
    extremes.add(elevation)
    extremes.refuse_detached(step_m, name)


_PLATEAU_SHARE, _CLIFFS = 0.1, 5.0


def log_plateau(elevation: FloatArray, name: str) -> None:
    """Log one height that many cells hold to the last digit, and at whose edge heights jump as nowhere else.

    Voids are often filled with 0 or a mean. The surface of water is as even, and meets its shore without such a jump.

    `elevation` (H, W): elevations [m], NaN where unknown.
    """
    even = elevation[:, 1:][np.diff(elevation) == 0.0]
    if even.size < _PLATEAU_SHARE * elevation.size:
        return
    heights, counts = np.unique(even, return_counts=True)
    is_even = elevation == (height := heights[counts.argmax()])
    steps, is_edge = (
        np.concatenate([np.abs(np.diff(grid, axis=k)).ravel() for k in (0, 1)])
        for grid in (elevation, is_even)
    )
    jumps, others = (steps[(steps > 0.0) & at] for at in (is_edge, ~is_edge))
    least_m = _CLIFFS * others.sum() / max(others.size, 1)
    if is_even.mean() >= _PLATEAU_SHARE and jumps.size and np.median(jumps) > least_m:
        found = f"{name} holds exactly {height:g} m in {is_even.mean():.0%} of its cells, and heights jump by {np.median(jumps):.3g} m at their edge"
        remedy = f"make it nodata (gdal_edit.py -a_nodata {height:g})"
        logging.getLogger(__name__).warning("%s: if the number stands for unknown cells, %s.", found, remedy)


def refuse_impossible(elevation: FloatArray, name: str) -> None:
    """Refuse elevations most of which are beyond any ground on Earth, as decimetres or millimetres without a unit are.

    `elevation` (H, W): elevations [m], NaN where unknown.
    """
    known = elevation[np.isfinite(elevation)]
    middle_m = float(np.median(known)) if known.size else 0.0
    if not LOWEST_M <= middle_m <= HIGHEST_M:
        raise InputError(
            f"{name} holds elevations about {middle_m:,.0f} m, beyond all ground on Earth; state the unit or the scale of its numbers "
            "(gdal_edit.py -scale 0.1 for decimetres), or name the unit with --units."
        )


class Extremes:
    """The lowest and the highest number of a raster, how many cells hold them, and where the others begin.

    Rasters that are read in blocks add one block after the other.

    >>> extremes = Extremes()
    >>> extremes.add(np.array([[812.0, 815.0], [811.0, 814.0]]))
    >>> extremes.add(np.array([[0.0], [0.0]]))
    >>> extremes.refuse_detached(10.0, "dem.tif")
    Traceback (most recent call last):
    survey.core.errors.InputError: dem.tif holds 2 cells of exactly 0 m, and all others are 811 m or more...
    """

    def __init__(self) -> None:
        self._low, self._negated_high = _NOTHING, _NOTHING

    def add(self, elevation: FloatArray) -> None:
        """Count the elevations of a block, NaN where unknown."""
        known = elevation[np.isfinite(elevation)]
        self._low = _merged(self._low, _lowest(known))
        self._negated_high = _merged(self._negated_high, _lowest(-known))

    def refuse_detached(self, step_m: float, name: str) -> None:
        """Raise InputError as `refuse_detached` does."""
        for sign, words, (number, n_cells, others) in (
            (1.0, "or more", self._low),
            (-1.0, "or less", self._negated_high),
        ):
            gap_m = others - number
            if n_cells >= _LEAST_CELLS and np.isfinite(gap_m) and gap_m > max(_LEAST_GAP_M, step_m):
                filled = sign * number + 0.0
                raise InputError(
                    f"{name} holds {n_cells} cells of exactly {filled:g} m, and all others are {sign * others:g} m {words}: "
                    f"{filled:g} stands for unknown cells and is not declared; make it nodata (gdal_edit.py -a_nodata {filled:g})."
                )


class _Lowest(NamedTuple):
    """The lowest number, how many cells hold it, and the next higher one; infinite where there is none."""

    number: float
    n_cells: int
    others: float


_NOTHING = _Lowest(np.inf, 0, np.inf)


def _lowest(known: FloatArray) -> _Lowest:
    if known.size == 0:
        return _NOTHING
    number = float(known.min())
    is_lowest = known == number
    others = known[~is_lowest]
    return _Lowest(number, int(is_lowest.sum()), float(others.min()) if others.size else np.inf)


def _merged(a: _Lowest, b: _Lowest) -> _Lowest:
    if a.number == b.number:
        return _Lowest(a.number, a.n_cells + b.n_cells, min(a.others, b.others))
    low, high = (a, b) if a.number < b.number else (b, a)
    return _Lowest(low.number, low.n_cells, min(low.others, high.number))
