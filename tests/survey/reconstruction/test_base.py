"""A reconstruction is whole, written as it is, and read as it was."""

from pathlib import Path

import numpy as np
import pytest
import rasterio

from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.terrain_map import Reconstruction

GRID = Grid((0.0, 0.0, 40.0, 30.0), 1.0, "EPSG:32608")


def _result(**changes: object) -> Reconstruction:
    rng = np.random.default_rng(0)
    values = {
        "mean": Dem.on(GRID, 1000.0 + rng.random(GRID.shape), "EGM2008 height"),
        "std": Dem.on(GRID, rng.random(GRID.shape), "EGM2008 height"),
        "support": rng.integers(0, 4, GRID.shape),
        "method": "gp",
        "hyperparameters": {"variance_m2": np.float64(4.0), "families": ["a", "b"]},
        "diagnostics": {"rows": np.arange(3)},
    }
    return Reconstruction(**(values | changes))  # type: ignore[arg-type]


def test_it_comes_back_from_its_folder(tmp_path: Path) -> None:
    result = _result(lower=_result().mean, upper=_result().mean)
    result.write(tmp_path)
    back = Reconstruction.read(tmp_path)
    # Rasters hold float32: 6e-5 m at 1,000 m.
    np.testing.assert_allclose(back.mean.elevation, result.mean.elevation, atol=1e-4)
    np.testing.assert_allclose(back.std.elevation, result.std.elevation, atol=1e-6)
    np.testing.assert_array_equal(back.support, result.support)
    assert dict(back.hyperparameters) == {"variance_m2": 4.0, "families": ["a", "b"]}
    assert back.diagnostics["rows"] == [0, 1, 2]
    assert back.mean.vertical_datum == "EGM2008 height"
    assert back.lower is not None


def test_the_raster_has_two_named_bands_and_its_crs(tmp_path: Path) -> None:
    _result().write(tmp_path)
    with rasterio.open(tmp_path / "dem.tif") as file:
        assert file.descriptions == ("elevation", "standard_deviation")
        assert file.crs.to_epsg() == 32608 or "UTM zone 8N" in file.crs.to_wkt()
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"


def test_equal_maps_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        _result().write(tmp_path / name)
    for file in (tmp_path / "one").iterdir():
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"support": np.zeros((2, 2))}, "support"),
        ({"support": np.full(GRID.shape, 7)}, "support"),
        ({"std": Dem.on(Grid((0.0, 0.0, 4.0, 4.0), 1.0), np.ones((5, 5)))}, "one grid"),
        ({"hyperparameters": {"kernel": object()}}, "JSON"),
        ({"hyperparameters": {"likelihood": float("nan")}}, "JSON"),
    ],
)
def test_what_does_not_fit_together_is_refused(changes: dict[str, object], word: str) -> None:
    with pytest.raises(InputError, match=word):
        _result(**changes)


def test_damaged_descriptions_are_refused(tmp_path: Path) -> None:
    _result().write(tmp_path)
    facts = tmp_path / "reconstruction.json"
    for text in ("{", "{}"):
        facts.write_text(text)
        with pytest.raises(InputError, match=r"reconstruction\.json"):
            Reconstruction.read(tmp_path)


def test_the_interval_is_the_mean_and_two_sigmas_unless_bounds_are_given() -> None:
    result = _result()
    lower, upper = result.interval()
    np.testing.assert_allclose(upper.elevation - lower.elevation, 2 * 1.959964 * result.std.elevation)
    assert _result(lower=result.mean, upper=result.mean).interval()[0] is not lower
