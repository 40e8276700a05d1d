"""Coordinate reference systems and vertical datums: checks, agreement, transformation.

Refuses what is unknown or does not agree; projects nothing without being asked. Importing this package keeps
PROJ from downloading grids, whatever ``PROJ_NETWORK`` says, because a data file decides by its CRS which grids
are asked for. ``FIRNLINE_PROJ_NETWORK=ON`` in the environment allows it.
"""

import os

from pyproj.network import set_network_enabled  # type: ignore[attr-defined]  # pyproj lists no exports

NETWORK_VARIABLE = "FIRNLINE_PROJ_NETWORK"
"""Environment variable that allows PROJ to download grids when it is ``ON``."""

if os.environ.get(NETWORK_VARIABLE) != "ON":
    os.environ["PROJ_NETWORK"] = "OFF"  # for the copies of PROJ within GDAL's bindings
    set_network_enabled(False)
