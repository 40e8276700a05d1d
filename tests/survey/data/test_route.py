import numpy as np
import pytest

from survey import InputError, Leg, Route
from survey.core.map_scale import ground_length_m
from survey.interchange import write_plan

CRS = "EPSG:32608"


@pytest.fixture
def hairpin() -> Route:
    legs = (
        Leg("swath", [[0.0, 0.0], [10.0, 0.0]]),
        Leg("transit", [[10.0, 0.0], [10.0, 5.0]]),
        Leg("swath", [[10.0, 5.0], [0.0, 5.0]]),
    )
    return Route(legs, CRS, "lawnmower", 5.0, {"time_s": 25.0})


def test_samples_lie_at_equal_distances_and_know_their_leg(hairpin):
    samples = hairpin.sample(2.5)
    np.testing.assert_allclose(samples.distance_m, np.arange(0.0, 25.1, 2.5))
    np.testing.assert_allclose(samples.xy[[0, 4, 6, 10]], [[0, 0], [10, 0], [10, 5], [0, 5]])
    np.testing.assert_array_equal(samples.leg, [0, 0, 0, 0, 1, 1, 2, 2, 2, 2, 2])
    np.testing.assert_allclose(samples.heading_rad[[0, 4, 6]], [0.0, np.pi / 2, np.pi])


def test_file_gives_the_route_back(hairpin, tmp_path):
    hairpin.write(tmp_path / "r.geojson")
    back = Route.read(tmp_path / "r.geojson")
    assert [leg.kind for leg in back.legs] == ["swath", "transit", "swath"]
    np.testing.assert_array_equal(back.path(), hairpin.path())
    assert back.prediction == {"time_s": 25.0}
    assert (back.pattern, back.spacing_m, back.crs) == ("lawnmower", 5.0, hairpin.crs)


def test_refuses_legs_that_do_not_join():
    with pytest.raises(InputError, match=r"jumps 5\.00 m"):
        Route((Leg("swath", [[0, 0], [1, 0]]), Leg("swath", [[1, 5], [0, 5]])), CRS, "x")


@pytest.mark.parametrize(
    ("kind", "xy", "words"),
    [
        ("swath", [[0, 0]], "at least two"),
        ("swim", [[0, 0], [1, 1]], "swath or transit"),
        ("swath", [[0, np.nan], [1, 1]], "NaN"),
    ],
)
def test_refuses_a_bad_leg(kind, xy, words):
    with pytest.raises(InputError, match=words):
        Leg(kind, xy)


def test_refuses_a_route_without_length():
    with pytest.raises(InputError, match="no length"):
        Route((Leg("swath", [[1, 1], [1, 1]]),), CRS, "x").sample(1.0)


def test_lengths_on_the_ground_are_those_of_the_projection_corrected():
    xy = np.array([[0.0, 8_500_000.0], [1000.0, 8_500_000.0], [1000.0, 8_502_000.0]])
    route = Route((Leg("swath", xy[:2]), Leg("transit", xy[1:])), "EPSG:3857", "x")
    assert route.length_m == 3000.0
    np.testing.assert_allclose(
        route.ground_leg_lengths_m, [ground_length_m("EPSG:3857", leg.xy) for leg in route.legs], rtol=1e-9
    )
    assert route.ground_length_m == pytest.approx(1490.0, rel=0.02)
    assert route.to_geodataframe()["length_m"].sum() == pytest.approx(route.ground_length_m)


@pytest.mark.parametrize("name", ["r.gpx", "r.kml", "r.csv", "r.shp", "r"])
def test_a_format_of_other_tools_names_what_writes_it(hairpin, tmp_path, name):
    with pytest.raises(InputError, match=r"survey\.interchange\.write_plan"):
        hairpin.write(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_the_function_that_the_refusal_names_writes_gpx(hairpin, tmp_path):
    write_plan(hairpin, tmp_path / "r.gpx")
    assert (tmp_path / "r.gpx").read_text(encoding="utf-8").startswith("<?xml")
