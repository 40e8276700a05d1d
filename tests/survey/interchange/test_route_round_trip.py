"""Routes of any shape come back from every format."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from survey.data.route import Leg, Route
from survey.interchange.route_formats import read_plan, write_plan

CRS = "EPSG:32608"
# Nine decimals of a degree are 0.06 mm of rounding; CSV has a tenth of a millimetre.
ROUNDING_M = 2e-4
STEPS = st.tuples(st.floats(-80.0, 80.0), st.floats(-80.0, 80.0)).filter(lambda step: np.hypot(*step) > 0.01)


@st.composite
def routes(draw) -> Route:
    """Connected legs of one rover; kinds alternate as they do on a drive."""
    place = np.array([draw(st.floats(450_000.0, 550_000.0)), draw(st.floats(6_600_000.0, 6_800_000.0))])
    legs = []
    for k in range(draw(st.integers(1, 4))):
        steps = draw(st.lists(STEPS, min_size=1, max_size=4))
        xy = place + np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
        legs.append(Leg("transit" if k % 2 else "swath", xy))
        place = xy[-1]
    return Route(tuple(legs), CRS, "lawnmower", 20.0)


@pytest.mark.property
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@pytest.mark.parametrize("ending", [".geojson", ".gpkg", ".kml", ".csv"])
@given(route=routes())
def test_legs_with_their_kinds_come_back(route: Route, ending: str, tmp_path: Path) -> None:
    write_plan(route, tmp_path / f"a{ending}")
    back = read_plan(tmp_path / f"a{ending}", crs=CRS)
    assert [leg.kind for leg in back.legs] == [leg.kind for leg in route.legs]
    for found, leg in zip(back.legs, route.legs, strict=True):
        np.testing.assert_allclose(found.xy, leg.xy, atol=ROUNDING_M)


@pytest.mark.property
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@pytest.mark.parametrize("ending", [".plan", ".waypoints", ".gpx"])
@given(route=routes())
def test_missions_hold_the_path_in_order(route: Route, ending: str, tmp_path: Path) -> None:
    write_plan(route, tmp_path / f"a{ending}")
    back = read_plan(tmp_path / f"a{ending}", crs=CRS)
    path = np.vstack([leg.xy for leg in route.legs])
    for place in path:
        distance = np.hypot(*(np.vstack([leg.xy for leg in back.legs]) - place).T)
        assert distance.min() < 0.05
    assert back.length_m == pytest.approx(route.length_m, abs=0.05 * len(path))
