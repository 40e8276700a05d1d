"""Layers of a QGIS project: files with the style in which they are drawn."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from survey.core.arrays import FloatArray

RasterStyle = Literal["elevation", "hillshade", "deviation", "support"]
VectorStyle = Literal["route", "area", "starts", "points"]


@dataclass(frozen=True)
class QgisLayer:
    """A file as a layer.

    Parameters
    ----------
    name : str
        Name in the legend.
    file : pathlib.Path
        A raster, or a GeoPackage or GeoJSON.
    style : {"elevation", "hillshade", "deviation", "support", "route", "area", "starts", "points"}
        How it is drawn.
    band : int
        Of rasters, counted from 1.
    limits : (2,) tuple of float
        Of elevation and deviation: the values at the ends of the colours [m].
    table : str
        Of vector files: the name of the layer within.
    n_rovers : int
        Of routes.
    is_visible : bool
        Whether the layer is switched on when the project is opened.
    """

    name: str
    file: Path
    style: RasterStyle | VectorStyle
    band: int = 1
    limits: tuple[float, float] = (0.0, 1.0)
    table: str = ""
    n_rovers: int = 1
    is_visible: bool = True

    @property
    def is_raster(self) -> bool:
        """Whether the file is a raster."""
        return self.style in ("elevation", "hillshade", "deviation", "support")


@dataclass(frozen=True)
class QgisGroup:
    """Layers under one heading of the legend, the uppermost first.

    Parameters
    ----------
    name : str
        The heading.
    layers : tuple of QgisLayer
        Its layers.
    """

    name: str
    layers: tuple[QgisLayer, ...]


def value_limits(values: FloatArray) -> tuple[float, float]:
    """Return lowest and highest known value, at least a millimetre apart.

    Parameters
    ----------
    values : ndarray
        Values [m], NaN where they are not known.

    Returns
    -------
    (2,) tuple of float
        For `QgisLayer.limits`.

    Examples
    --------
    >>> value_limits(np.array([1.0, np.nan, 3.0]))
    (1.0, 3.0)
    """
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return low, max(high, low + 1e-3)
