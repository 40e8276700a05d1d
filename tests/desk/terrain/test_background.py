"""The background of the map: local pictures warped to tiles, and map services that the user names."""

import io
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image
from pyproj import CRS, Transformer
from rasterio.transform import from_origin

from desk.server.gate import Gate
from desk.server.serve import desk_app
from desk.terrain.background import (
    GroundPicture,
    MapService,
    halved,
    is_picture,
    open_background,
    store_picture,
    stored_picture,
    widened,
)
from survey.core.errors import InputError
from tests.desk.conftest import PORT, SOUTH, WEST, Page

BOUNDS = (WEST, SOUTH, WEST + 900.0, SOUTH + 900.0)
UTM = CRS("EPSG:32608")
XYZ = "https://tiles.example/{z}/{x}/{y}.png"


def write_picture(file: Path, values: np.ndarray, crs: str = "EPSG:32608", **profile) -> Path:
    """Write bands (bands, 90, 90) over the terrain; in degrees over the same ground."""
    left, bottom, right, top = BOUNDS
    if crs not in (None, "EPSG:32608"):
        transformer = Transformer.from_crs("EPSG:32608", crs, always_xy=True)
        left, bottom, right, top = transformer.transform_bounds(*BOUNDS)
    count, height, width = values.shape
    transform = from_origin(left, top, (right - left) / width, (top - bottom) / height)
    shape = {"count": count, "height": height, "width": width, "dtype": values.dtype}
    with rasterio.open(
        file, "w", **{"driver": "GTiff", "crs": crs, "transform": transform} | shape | profile
    ) as target:
        target.write(values)
    return file


def halves(dtype="uint8", low=0, high=200) -> np.ndarray:
    """Return a red western and a blue eastern half."""
    values = np.full((3, 90, 90), low, dtype=dtype)
    values[0, :, :45], values[2, :, 45:] = high, high
    return values


def colours_at(picture: GroundPicture, places: list[tuple[float, float]]) -> np.ndarray:
    """Return red, green, blue and opacity (N, 4) that the finest tiles show at places of the map."""
    grid = picture.about["grid"]
    zoom = len(grid["resolutions_m"]) - 1
    cell_m, found = grid["resolutions_m"][zoom], []
    for x, y in places:
        column, row = int((x - grid["extent"][0]) / cell_m), int((grid["extent"][3] - y) / cell_m)
        tile = Image.open(io.BytesIO(picture.png(zoom, column // 256, row // 256)))
        found.append(np.asarray(tile)[row % 256, column % 256])
    return np.array(found)


@pytest.mark.parametrize("crs", ["EPSG:32608", "EPSG:4326", "EPSG:3857"])
def test_a_picture_in_any_crs_lies_where_it_belongs(tmp_path, crs):
    picture = GroundPicture(write_picture(tmp_path / "ortho.tif", halves(), crs), UTM, BOUNDS)
    places = [(WEST + 300.0, SOUTH + 450.0), (WEST + 600.0, SOUTH + 450.0), (WEST - 300.0, SOUTH + 450.0)]
    red, blue, beyond = colours_at(picture, places)
    assert red.tolist() == [200, 0, 0, 255]
    assert blue.tolist() == [0, 0, 200, 255]
    assert beyond[3] == 0


def test_numbers_beyond_bytes_are_stretched(tmp_path):
    picture = GroundPicture(write_picture(tmp_path / "ortho.tif", halves("uint16", 900, 4000)), UTM, BOUNDS)
    assert colours_at(picture, [(WEST + 300.0, SOUTH + 450.0)])[0].tolist() == [255, 0, 0, 255]


def test_a_palette_and_grey_values_are_drawn(tmp_path):
    file = write_picture(tmp_path / "map.tif", halves()[:1])
    assert colours_at(GroundPicture(file, UTM, BOUNDS), [(WEST + 300.0, SOUTH + 450.0)])[0].tolist() == [
        200
    ] * 3 + [255]
    with rasterio.open(file, "r+") as target:
        target.write_colormap(1, {0: (0, 0, 0, 255), 200: (12, 34, 56, 255)})
    assert is_picture(file)
    assert colours_at(GroundPicture(file, UTM, BOUNDS), [(WEST + 300.0, SOUTH + 450.0)])[0].tolist()[:3] == [
        12,
        34,
        56,
    ]


def test_unknown_cells_are_transparent(tmp_path):
    picture = GroundPicture(write_picture(tmp_path / "ortho.tif", halves(), nodata=0), UTM, BOUNDS)
    file = write_picture(tmp_path / "dark.tif", np.zeros((3, 90, 90), np.uint8), nodata=0)
    assert colours_at(picture, [(WEST + 300.0, SOUTH + 450.0)])[0, 3] == 255
    assert colours_at(GroundPicture(file, UTM, BOUNDS), [(WEST + 300.0, SOUTH + 450.0)])[0, 3] == 0


def test_mbtiles_are_drawn(tmp_path):
    file = write_picture(tmp_path / "ortho.tif", halves(), "EPSG:3857")
    from rasterio.shutil import copy

    copy(file, tmp_path / "ortho.mbtiles", driver="MBTILES", TILE_FORMAT="PNG")
    picture = GroundPicture(tmp_path / "ortho.mbtiles", UTM, BOUNDS)
    assert colours_at(picture, [(WEST + 300.0, SOUTH + 450.0)])[0].tolist() == pytest.approx(
        [200, 0, 0, 255], abs=2
    )
    assert is_picture(tmp_path / "ortho.mbtiles")


def test_widths_of_cells_reach_those_of_the_picture():
    assert widened((0.0, 0.0, 200.0, 100.0)) == (-100.0, -100.0, 300.0, 200.0)
    widths = halved((0.0, 0.0, 256.0, 100.0), 0.1)
    assert widths[0] == 1.0
    assert 0.05 < widths[-1] <= 0.1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda at: write_picture(at / "a.tif", halves(), crs=None), "no coordinate reference system"),
        (
            lambda at: write_picture(at / "a.tif", halves(), transform=from_origin(5.0, 5.0, 2.0, 2.0)),
            "lies elsewhere",
        ),
        (lambda at: at / "missing.tif", "does not exist"),
        (lambda at: at / "notes.txt", "no picture"),
    ],
)
def test_a_picture_that_cannot_be_shown_is_refused_in_a_sentence(tmp_path, make, words):
    with pytest.raises(InputError, match=words) as refused:
        GroundPicture(make(tmp_path), UTM, BOUNDS)
    assert str(refused.value).endswith(".")


@pytest.mark.parametrize("suffix", [".tif", ".mbtiles"])
def test_a_damaged_picture_is_refused(tmp_path, suffix):
    (tmp_path / f"bad{suffix}").write_bytes(b"II*\0" + bytes(400))
    with pytest.raises(InputError, match="bad"):
        GroundPicture(tmp_path / f"bad{suffix}", UTM, BOUNDS)


def test_an_address_names_one_host():
    service = open_background(XYZ, UTM, BOUNDS)
    assert service.host == "https://tiles.example"
    assert service.png(0, 0, 0) is None


@pytest.mark.parametrize(
    "address",
    [
        "https://tiles.example/map.png",
        "https://a b/{z}/{x}/{y}.png",
        "https://x;script-src%20*/{z}/{x}/{y}.png",
        "https://user:word@tiles.example/{z}/{x}/{y}.png",
        "https://{s}.tiles.example/{z}/{x}/{y}.png",
        "ftp://tiles.example/{z}/{x}/{y}.png",
        "https:///{z}/{x}/{y}.png",
    ],
)
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(InputError, match="background"):
        open_background(address, UTM, BOUNDS)


def test_the_map_of_web_mercator_is_exact():
    service = MapService.of(XYZ, UTM, (WEST, SOUTH, WEST + 50_000.0, SOUTH + 50_000.0))
    places = np.random.default_rng(1).uniform(0.0, 50_000.0, (200, 2)) + (WEST, SOUTH)
    there = np.column_stack(Transformer.from_crs(UTM, "EPSG:3857", always_xy=True).transform(*places.T))
    assert np.abs(evaluated(service.about["to_mercator"], places) - there).max() < 1e-2
    assert np.abs(evaluated(service.about["from_mercator"], there) - places).max() < 1e-2


def evaluated(polynomial: dict, places: np.ndarray) -> np.ndarray:
    u, v = ((places - polynomial["centre"]) / polynomial["scale"]).T
    terms = np.column_stack([u**i * v**j for i, j in polynomial["powers"]])
    return terms @ np.array(polynomial["factors"]).T + polynomial["offset"]


def test_xyz_is_refused_near_a_pole_and_wms_is_asked_in_the_crs_of_the_map():
    polar = CRS("EPSG:3413")
    with pytest.raises(InputError, match="85 degrees"):
        open_background(XYZ, polar, (0.0, -1000.0, 1000.0, 0.0))
    about = open_background("https://maps.example/wms?layers=ice", polar, (0.0, -1000.0, 1000.0, 0.0)).about
    assert "SRS=EPSG:3413" in about["address"]
    with pytest.raises(InputError, match="no code"):
        open_background(
            "https://maps.example/wms?layers=ice", CRS("+proj=tmerc +lon_0=1.234 +lat_0=3"), BOUNDS
        )


def test_a_dropped_picture_is_stored_beside_the_plan_and_replaced(tmp_path):
    content = write_picture(tmp_path / "ortho.tif", halves()).read_bytes()
    assert stored_picture(tmp_path / "plan") is None
    store_picture(tmp_path / "plan", "ortho.tif", content, UTM, BOUNDS)
    assert stored_picture(tmp_path / "plan") == tmp_path / "plan_background.tif"
    with pytest.raises(InputError, match=r"^.*other\.tif"):
        store_picture(tmp_path / "plan", "other.tif", b"II*\0" + bytes(400), UTM, BOUNDS)
    assert stored_picture(tmp_path / "plan").read_bytes() == content
    assert sorted(file.name for file in tmp_path.iterdir()) == ["ortho.tif", "plan_background.tif"]


def test_a_dropped_picture_is_shown_over_the_server(page, workspace, tmp_path):
    assert page.get("/api/site").json()["background"] is None
    assert page.get("/tiles/background/0/0/0.png").status_code == 404
    content = write_picture(tmp_path / "ortho.tif", halves()).read_bytes()
    assert page.post("/api/dropped?name=ortho.tif", content).json() == {"kind": "picture"}
    about = page.post("/api/background?name=ortho.tif", content).json()
    assert about["title"] == "ortho.tif"
    assert page.get("/tiles/background/0/0/0.png").headers["content-type"] == "image/png"
    assert page.get("/tiles/background/99/0/0.png").status_code == 404
    assert page.get("/tiles/background/0/0/99999999.png").status_code == 404
    assert page.get("/api/site").json()["background"]["address"] == about["address"]
    assert page.post("/api/background?name=ortho.txt", b"x").status_code == 422


def test_a_raster_of_one_band_is_asked_about(page, dem_file):
    content = dem_file.read_bytes()
    assert page.post("/api/dropped?name=a.tif", content).json() == {"kind": "either"}
    assert page.post("/api/dropped?name=a.tif&select=elevations", content).json()["kind"] == "raster"


def test_the_policy_names_the_host_of_a_service_for_images_alone(workspace):
    plain = Page(Gate(desk_app(workspace), PORT)).get("/").headers["content-security-policy"]
    service = MapService.of(XYZ, UTM, BOUNDS)
    named = Page(Gate(desk_app(workspace), PORT, service.host)).get("/").headers
    assert "//" not in plain
    assert named["content-security-policy"] == plain.replace("blob:;", "blob: https://tiles.example;")
    assert named["content-security-policy"].count("tiles.example") == 1
    assert named["referrer-policy"] == "origin"
