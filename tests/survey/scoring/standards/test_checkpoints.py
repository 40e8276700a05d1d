"""Checkpoints are read with their names, kept apart from control, well placed, and compared where they lie."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS

from survey import Dem, Grid, InputError, SurveyArea
from survey.core.transformation import transformed
from survey.data.route import Leg, Route
from survey.io.vector import write_features
from survey.scoring import Checkpoints, compare, design_checkpoints
from survey.scoring.standards.checkpoint_errors import Spread
from survey.scoring.standards.checkpoints import control_places

UTM = "EPSG:32608"
XYZ = np.array(
    [[500_010.0, 6_700_020.0, 101.0], [500_030.0, 6_700_040.0, 102.0], [500_050.0, 6_700_015.0, 99.5]]
)
CSV = "name,x_m,y_m,z_m,sigma_z_m\n" + "".join(f"M{k},{x},{y},{z},0.02\n" for k, (x, y, z) in enumerate(XYZ))


def test_csv_geopackage_and_gpx_tell_the_same_points(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(CSV)
    names = np.array(["M0", "M1", "M2"], dtype=object)
    columns = {"name": names, "sigma_z_m": np.full(3, 0.02)}
    write_features(tmp_path / "a.gpkg", shapely.points(XYZ), columns, CRS(UTM), layer="marks")
    degrees = transformed(XYZ[:, :2], CRS(UTM), CRS("EPSG:4326"), "the marks")
    columns = {"name": names, "ele": XYZ[:, 2]}
    write_features(tmp_path / "a.gpx", shapely.points(degrees), columns, CRS("EPSG:4326"), layer="waypoints")
    for suffix, sigma in (("csv", None), ("gpkg", None), ("gpx", 0.02)):
        found = Checkpoints.read(tmp_path / f"a.{suffix}", crs=UTM, sigma_m=sigma)
        # GPX is written with about nine decimals of a degree: 0.1 mm.
        np.testing.assert_allclose(found.xyz, XYZ, rtol=0, atol=2e-4)
        assert found.names == ("M0", "M1", "M2")
        assert found.sigma_z_m.tolist() == [0.02] * 3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CSV.replace(",sigma_z_m", ",height"), "uncertainty"),
        (CSV.replace("M1", "M0"), "several points 'M0'"),
        (CSV.replace("0.02", "0.0"), "sigma of 0 or less"),
        (CSV.replace("500030.0,6700040.0", "500010.0,6700020.0"), "M0 and M1 lie at one place"),
        (CSV.replace("sigma_z_m", "sigma_z_m,control").replace("0.02\n", "0.02,1\n"), "served as control"),
        ("name,x_m,y_m\nA,1,2\n", "z_m"),
    ],
)
def test_bad_checkpoints_are_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        Checkpoints.read(tmp_path / "bad.csv", crs=UTM)


def test_control_points_are_no_checkpoints(tmp_path: Path) -> None:
    points = Checkpoints(XYZ, 0.02, UTM)
    points.refuse_control(XYZ[:, :2] + 1.0)
    (tmp_path / "control.csv").write_text("x_m,y_m,z_m\n500030.05,6700040.0,0\n")
    with pytest.raises(InputError, match="checkpoint 2 lie within"):
        points.refuse_control(control_places(tmp_path / "control.csv", UTM))


def test_errors_are_map_minus_checkpoint_and_what_is_left_out_is_named(plane: Dem) -> None:
    xy = np.array([[12.5, 7.5], [51.0, 33.0], [90.0, 45.0], [500.0, 0.0]])
    heights = 100.0 + 0.1 * xy[:, 0] - 0.2 * xy[:, 1]
    values = plane.elevation.copy()
    values[:2, -4:] = np.nan
    holed = Dem(values, plane.transform, plane.crs)
    found = compare(holed, Checkpoints(np.column_stack([xy, heights - 0.3]), 0.02, plane.crs))
    # Bilinear interpolation of a plane is exact.
    np.testing.assert_allclose(found.errors_m, [0.3, 0.3], atol=1e-12)
    assert (found.left_out, found.n_outside, found.without_datum) == (
        ("3",),
        1,
        ("the heights of the map", "the checkpoints"),
    )


def test_mixed_datums_and_systems_are_refused(plane: Dem) -> None:
    geoidal = Dem(plane.elevation, plane.transform, plane.crs, "EGM96 height")
    with pytest.raises(InputError, match="vertical datums"):
        compare(geoidal, Checkpoints([[10.0, 10.0, 5.0]], 0.1, plane.crs, "ellipsoidal height"))
    with pytest.raises(InputError, match="different systems"):
        compare(geoidal, Checkpoints([[10.0, 10.0, 5.0]], 0.1, "EPSG:32609"))
    with pytest.raises(InputError, match="none where the map"):
        compare(geoidal, Checkpoints([[1e5, 10.0, 5.0]], 0.1, plane.crs))


def test_designed_checkpoints_keep_every_rule() -> None:
    area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), UTM)
    grid = Grid((0.0, 0.0, 600.0, 600.0), 10.0, UTM)
    # Steep in the east, beyond x = 500.
    terrain = Dem.on(
        grid, np.where(grid.x[None, :] > 500.0, 0.5 * (grid.x - 500.0), 0.0) + 0.0 * grid.y[:, None]
    )
    lines = [Leg("swath", [[40.0 + 130 * k, 20.0], [40.0 + 130 * k, 580.0]], rover=k) for k in range(4)]
    route = Route(tuple(lines), UTM, "lines")
    places = design_checkpoints(
        area, 20, np.random.default_rng(3), terrain=terrain, route=route, reach_m=40.0, max_slope_deg=10.0
    )
    spread = Spread.of(places, area)
    assert min(spread.quadrant_shares) >= 0.2
    assert spread.spacing_share >= 0.1
    assert (terrain.slope().at(places) <= 10.0).all()
    assert max(route.line.distance(point) for point in shapely.points(places)) <= 40.0
    again = design_checkpoints(
        area, 20, np.random.default_rng(3), terrain=terrain, route=route, reach_m=40.0, max_slope_deg=10.0
    )
    np.testing.assert_array_equal(places, again)


def test_what_does_not_fit_is_refused_with_the_reason() -> None:
    area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), UTM)
    with pytest.raises(InputError, match=r"200 checkpoints do not fit: \d+ were placed at 85 m"):
        design_checkpoints(area, 200, np.random.default_rng(3))
    assert len(design_checkpoints(area, 1, np.random.default_rng(3))) == 1
