"""Georeference of rasters: north-up, with square cells."""

from affine import Affine

from survey.core.errors import InputError

_SMALLEST_M = 1e-4


def check_transform(t: Affine) -> None:
    """Refuse a transform that is not north-up with square cells.

    Parameters
    ----------
    t : affine.Affine
        Maps (column, row) of a cell's upper left corner to easting and northing [m].

    Raises
    ------
    InputError
        No georeference, a rotated or south-up raster, cells that are not square or smaller than 0.1 mm.

    Examples
    --------
    >>> check_transform(Affine(3.0, 0.0, 500_000.0, 0.0, -3.0, 6_700_000.0))
    """
    if t == Affine.identity():
        raise InputError(
            "the raster has no georeference; assign one (gdal_edit.py -a_ullr), and in NetCDF give the axes the standard_name "
            "projection_x_coordinate and projection_y_coordinate."
        )
    if t.b != 0.0 or t.d != 0.0:
        raise InputError(
            "the raster is rotated; rows must run west to east, warp it to north-up first (gdalwarp does it)."
        )
    if t.a <= 0.0 or t.e >= 0.0:
        raise InputError(
            f"the raster's cell is {t.a:g} by {t.e:g} m; the first row must be the northern one and the first column the western "
            "one, warp it to north-up first (gdalwarp does it)."
        )
    if abs(t.a + t.e) > 1e-3 * t.a:
        raise InputError(
            f"the raster's cells measure {t.a:g} × {-t.e:g} m; square cells are needed, resample it first."
        )
    if t.a < _SMALLEST_M:
        raise InputError(
            f"the raster's cells measure {t.a:g} m, and coordinates cannot resolve cells below {_SMALLEST_M:g} m; check its transform."
        )
