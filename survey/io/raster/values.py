"""Values of raster bands: scale, offset, units of length, and what is no elevation."""

from typing import Any, NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

FOOT_M, US_SURVEY_FOOT_M = 0.3048, 1200.0 / 3937.0
_METRES = {
    "": 1.0,
    "m": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "mm": 1e-3,
    "millimetre": 1e-3,
    "millimeter": 1e-3,
    "millimetres": 1e-3,
    "millimeters": 1e-3,
    "cm": 1e-2,
    "centimetre": 1e-2,
    "centimeter": 1e-2,
    "centimetres": 1e-2,
    "centimeters": 1e-2,
    "dm": 1e-1,
    "decimetre": 1e-1,
    "decimeter": 1e-1,
    "decimetres": 1e-1,
    "decimeters": 1e-1,
    "km": 1e3,
    "kilometre": 1e3,
    "kilometer": 1e3,
    "kilometres": 1e3,
    "kilometers": 1e3,
    "ft": FOOT_M,
    "foot": FOOT_M,
    "feet": FOOT_M,
    "international foot": FOOT_M,
    "international feet": FOOT_M,
    "us survey foot": US_SURVEY_FOOT_M,
    "us survey feet": US_SURVEY_FOOT_M,
    "us_survey_foot": US_SURVEY_FOOT_M,
    "us-ft": US_SURVEY_FOOT_M,
    "ftus": US_SURVEY_FOOT_M,
    "foot_us": US_SURVEY_FOOT_M,
    "sft": US_SURVEY_FOOT_M,
}
_PICTURES = frozenset(
    [
        "palette",
        "red",
        "green",
        "blue",
        "alpha",
        "hue",
        "saturation",
        "lightness",
        "cyan",
        "magenta",
        "yellow",
        "black",
        "Y",
        "Cb",
        "Cr",
    ]
)
# Values by which rasters mark unknown cells, here where they are not declared as nodata; and what no band holds.
_MARKS = (-9999.0, -32767.0, -32768.0, -99999.0)
_LARGEST = 1e15


class BandScale(NamedTuple):
    """Stored numbers times `factor` plus `offset` are metres."""

    factor: float = 1.0
    offset: float = 0.0

    def applied(self, stored: FloatArray) -> FloatArray:
        """Return metres (h, w); numbers that are metres already come back bit by bit.

        Parameters
        ----------
        stored : (h, w) ndarray
            Numbers as the file stores them.

        Returns
        -------
        (h, w) ndarray
            Metres.
        """
        if self == (1.0, 0.0):
            return stored
        return stored * self.factor + self.offset


def band_scale(source: Any, band: int) -> BandScale:
    """Return scale and offset of an open raster's band, the conversion of its unit to metres included.

    Parameters
    ----------
    source : rasterio.DatasetReader
        An open raster.
    band : int
        Counted from 1.

    Returns
    -------
    BandScale
        From stored numbers to metres.

    Raises
    ------
    InputError
        The band counts in a unit that is no known length, or its scale is 0 or not finite.
    """
    unit = (source.units[band - 1] or "").strip()
    metres = _METRES.get(unit.lower())
    if metres is None:
        raise InputError(
            f"band {band} of {source.name} counts in {unit[:40]!r}; metres or a known unit of length were expected, convert it first."
        )
    scale, offset = float(source.scales[band - 1]), float(source.offsets[band - 1])
    if not (np.isfinite([scale, offset]).all() and scale != 0.0):
        raise InputError(
            f"band {band} of {source.name} has the scale {scale:g} and the offset {offset:g}; it is damaged, get it again."
        )
    return BandScale(scale * metres, offset * metres)


def refuse_picture(source: Any, band: int) -> None:
    """Refuse a band of a picture or a mask of single bits: it is no elevation.

    Parameters
    ----------
    source : rasterio.DatasetReader
        An open raster.
    band : int
        Counted from 1.

    Raises
    ------
    InputError
        The band is a colour, an index into a palette, a transparency, or has one bit per cell.
    """
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


def refuse_unmarked(stored: FloatArray, name: str) -> None:
    """Refuse stored numbers (h, w) that mean an unknown cell without being declared as nodata.

    Parameters
    ----------
    stored : (h, w) ndarray
        Numbers as the file stores them, NaN for nodata.
    name : str
        Name of the file, for the message.

    Raises
    ------
    InputError
        A number such as -9999, -32768 or -3.4e38 is among them.
    """
    known = stored[np.isfinite(stored)]
    if len(known) == 0:
        return
    lowest, highest = float(known.min()), float(known.max())
    largest = max(-lowest, highest)
    found = next((mark for mark in _MARKS if lowest <= mark and (known == mark).any()), None)
    if found is None and largest < _LARGEST:
        return
    value = found if found is not None else (lowest if -lowest == largest else highest)
    raise InputError(
        f"{name} holds the number {value:g}, which is no elevation and not declared as nodata; declare it (gdal_edit.py -a_nodata {value:g})."
    )
