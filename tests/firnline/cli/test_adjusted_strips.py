"""``firnline reconstruct`` with overlapping strips: what is said, stored and refused."""

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from typer.testing import CliRunner, Result

from firnline.cli.main import app
from survey import SurfacePoints
from tests.survey.reconstruction.test_strip_adjustment import HEIGHT_M, three


def invoked(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["reconstruct", *map(str, arguments)])


def las_of(path: Path, points: SurfacePoints, overlap: np.ndarray | bool = False) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.0001)
    header.add_crs(CRS("EPSG:32608"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.xyz.T
    las.classification = np.full(len(points), 2, dtype=np.uint8)
    las.point_source_id = points.values["strip"].astype(np.uint16)
    las.overlap = np.broadcast_to(overlap, len(points)).astype(np.uint8)
    las.write(str(path))
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return las_of(tmp_path_factory.mktemp("strips") / "a.las", three())


OPTIONS = ["--sigma", "0.03", "--grid", "5", "--method", "tin", "--no-pictures"]


def test_a_difference_of_strips_is_said_and_stored(file: Path, tmp_path: Path) -> None:
    result = invoked(file, *OPTIONS, "-o", tmp_path / "map")
    assert result.exit_code == 0, result.output
    assert "3 strips" in result.output
    assert "--adjust-strips removes it" in " ".join(result.output.split())
    facts = json.loads((tmp_path / "map" / "reconstruction.json").read_text())["diagnostics"]
    assert facts["strip_adjustment"]["is_adjusted"] is False
    assert facts["strip_adjustment"]["rms_before_m"] > 0.1


def test_strips_are_adjusted_before_they_are_mapped(file: Path, tmp_path: Path) -> None:
    result = invoked(file, *OPTIONS, "--adjust-strips", "-o", tmp_path / "map")
    assert result.exit_code == 0, result.output
    facts = json.loads((tmp_path / "map" / "reconstruction.json").read_text())["diagnostics"]
    heights = [facts["strips"][name]["height_m"] for name in ("7", "8", "9")]
    assert heights == pytest.approx(HEIGHT_M - HEIGHT_M.mean(), abs=0.006)
    assert facts["strip_adjustment"]["rms_after_m"] < 0.1 * facts["strip_adjustment"]["rms_before_m"]
    assert "adjusted by" in result.output


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--tiles"], "maps in tiles adjust strips in any case"),
        (["--rays", "--method", "field"], "--adjust-strips moves points"),
        (["--method", "carving"], "--adjust-strips moves points"),
        (["--value", "strip"], "--adjust-strips moves points"),
    ],
)
def test_what_does_not_go_with_an_adjustment_is_refused(
    file: Path, tmp_path: Path, options: list[str], said: str
) -> None:
    result = invoked(file, "--sigma", 0.03, *options, "--adjust-strips", "-o", tmp_path / "map")
    assert result.exit_code == 3
    assert said in " ".join(result.output.split())


def test_points_of_one_strip_are_not_adjusted(tmp_path: Path) -> None:
    points = three()
    one = las_of(tmp_path / "a.las", points.select(points.values["strip"] == 7))
    result = invoked(one, *OPTIONS, "--adjust-strips", "-o", tmp_path / "map")
    assert result.exit_code == 3
    assert "does not name several strips" in " ".join(result.output.split())


def test_points_with_the_overlap_flag_are_counted_and_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    points = three()
    flagged = (points.xy[:, 0] > 40.0) & (points.xy[:, 0] < 60.0)
    las_of(tmp_path / "a.las", points, flagged)
    result = invoked(tmp_path / "a.las", *OPTIONS, "-o", tmp_path / "map")
    assert result.exit_code == 0, result.output
    assert f"flags {flagged.sum()} of {len(points)} points as overlap" in caplog.text
    assert len(SurfacePoints.read(tmp_path / "a.las", sigma_m=0.1)) == len(points)
