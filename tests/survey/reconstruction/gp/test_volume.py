"""Areas add up, and volumes of known surfaces are known."""

import pytest
import shapely

from survey.core.errors import InputError
from survey.reconstruction.gp.gp_terrain import Volume, quadrature


def test_the_areas_add_up_to_the_polygon() -> None:
    polygon = shapely.Point(30.0, 40.0).buffer(17.0)
    nodes, areas = quadrature(polygon, 1.0)
    assert areas.sum() == pytest.approx(polygon.area)
    assert shapely.contains_xy(polygon, *nodes.T).all()


def test_a_rectangle_integrates_a_plane_exactly() -> None:
    nodes, areas = quadrature(shapely.box(0.0, 0.0, 10.0, 6.0), 2.0)
    assert areas @ (1.0 + nodes[:, 0]) == pytest.approx(60.0 * 6.0)


@pytest.mark.parametrize("polygon", [shapely.Polygon(), shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])])
def test_no_polygon_is_refused(polygon: shapely.Polygon) -> None:
    with pytest.raises(InputError, match="polygon"):
        quadrature(polygon, 1.0)


def test_changes_add_their_variances_and_need_one_ground() -> None:
    change = Volume(90.0, 3.0, 10.0).minus(Volume(100.0, 4.0, 10.0))
    assert (change.mean_m3, change.std_m3) == (-10.0, 5.0)
    with pytest.raises(InputError, match="same polygon"):
        Volume(1.0, 1.0, 10.0).minus(Volume(1.0, 1.0, 11.0))
