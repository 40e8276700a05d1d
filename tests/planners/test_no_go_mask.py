import numpy as np
import pytest
import shapely
from affine import Affine

from planners.routes.traversability import without_marked
from survey import Dem, InputError, SurveyArea

CRS = "EPSG:32608"
SITE = SurveyArea(shapely.box(0.0, 0.0, 100.0, 100.0), CRS, starts=[[5.0, 5.0]])


def mask(*cells: tuple[int, int], value: float = 1.0, crs: str = CRS) -> Dem:
    values = np.zeros((10, 10))
    for row, column in cells:
        values[row, column] = value
    return Dem(values, Affine(10, 0, 0, 0, -10, 100), crs)


def test_marked_cells_and_half_a_cell_about_them_become_no_go_ground():
    free = without_marked(SITE, mask((4, 4), (4, 5))).free
    assert not free.intersects(shapely.box(36.0, 46.0, 64.0, 64.0).buffer(-0.1))
    assert 0.9 < free.area / SITE.free.area < 0.97


def test_an_empty_mask_changes_nothing():
    assert without_marked(SITE, mask()) is SITE


@pytest.mark.parametrize(
    ("raster", "message"),
    [
        (mask((4, 4), value=7.0), "holds values from 0 to 7; 1 for no-go ground"),
        (mask((9, 0)), "start"),
        (mask(*((r, c) for r in range(10) for c in range(10))), "nothing is left"),
        (mask((4, 4), crs="EPSG:32633"), "different systems"),
    ],
    ids=["other values", "start", "all", "crs"],
)
def test_masks_that_do_not_fit_are_refused(raster, message):
    with pytest.raises(InputError, match=message):
        without_marked(SITE, raster)
