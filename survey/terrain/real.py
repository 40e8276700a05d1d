"""Real elevations that matplotlib ships: the Jacksboro fault, Tennessee, from the Shuttle radar mission."""

from typing import NamedTuple

import numpy as np
from affine import Affine
from pyproj import CRS

from survey.core.errors import InputError
from survey.core.transformation import WGS84
from survey.data.dem import Dem
from survey.io.raster import Raster, reproject

_FILE = "jacksboro_fault_dem.npz"
_UTM = CRS("EPSG:32616")
# The Shuttle mission's heights count from this geoid; the file itself does not say so.
_VERTICAL_DATUM = "EGM96 height"


class SampleSite(NamedTuple):
    """A real site with its coarse prior.

    `prior`: coarse cells on and around the site. `bounds` (4,): west, south, east and north of the site [m].
    """

    prior: Dem
    bounds: tuple[float, float, float, float]


def real_sample(cell_m: float = 75.0) -> Dem:
    """Return the real terrain that matplotlib installs, in UTM zone 16N.

    344 × 403 cells of 3 arc-seconds from the Shuttle Radar Topography Mission (about 32 km by
    30 km, 236 to 1076 m), found through matplotlib's own sample-data call and reprojected
    bilinearly.

    `cell_m`: width of the square cells [m]; the source has about 75 m by 93 m.

    The source has whole metres. Of its stored latitudes ``ymax`` (36.446°) is the northern
    edge; ``ymin`` (36.733°) is wrong, being counted northward from there: with 36.446° the
    highest cell falls on the summit of Cross Mountain (36.1983° N, 84.2306° W, 1077 m).
    Heights include trees, as the radar saw them.

    >>> dem = real_sample()
    >>> dem.crs.name, dem.vertical_datum
    ('WGS 84 / UTM zone 16N', 'EGM96 height')
    """
    warped = reproject(_read(), _UTM, cell_m)
    return Dem(warped.values, warped.transform, _UTM, warped.vertical_datum)


def sample_site(row: int = 197, column: int = 238, n_cells: int = 8, margin: int = 4) -> SampleSite:
    """Return a window of the real sample as the coarse prior of a site, by default a flank of 25 m relief.

    The default is the window of 23 to 27 m relief that departs least from a plane: a simple
    downward slope, as the site of the glacier paper is.

    Returns: the prior with its margin, and the bounds of the site within it [m].

    >>> site = sample_site()
    >>> site.prior.shape, site.bounds[2] - site.bounds[0]
    ((16, 16), 600.0)
    """
    dem = real_sample()
    size = n_cells + 2 * margin
    first_row, first_column = row - margin, column - margin
    cells = dem.elevation[first_row : first_row + size, first_column : first_column + size]
    if min(first_row, first_column) < 0 or cells.shape != (size, size) or np.isnan(cells).any():
        raise InputError(
            f"the window at row {row}, column {column} with a margin of {margin} cells reaches beyond the sample's "
            f"{dem.shape[0]} × {dem.shape[1]} cells; choose another place."
        )
    prior = Dem(
        cells, dem.transform @ Affine.translation(first_column, first_row), dem.crs, dem.vertical_datum
    )
    xmin, ymin, xmax, ymax = prior.bounds
    inset = margin * dem.step_m
    return SampleSite(prior, (xmin + inset, ymin + inset, xmax - inset, ymax - inset))


def _read() -> Raster:
    from matplotlib.cbook import get_sample_data

    try:
        with np.load(get_sample_data(_FILE, asfileobj=False)) as stored:
            arrays = {name: np.asarray(stored[name], dtype=np.float64) for name in stored}
    except OSError as error:
        raise InputError(
            f"matplotlib's sample {_FILE} is not installed ({error}); install matplotlib from its wheel."
        ) from error
    # The stored ymax is the northern edge, but ymin was reckoned north of it; it is not used.
    west, north = float(arrays["xmin"]), float(arrays["ymax"])
    transform = Affine(float(arrays["dx"]), 0.0, west, 0.0, -float(arrays["dy"]), north)
    return Raster(arrays["elevation"], transform, WGS84, _VERTICAL_DATUM)
