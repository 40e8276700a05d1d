"""Worlds for other simulators, read back by the rules of their formats."""

import json
import struct
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely

from sim.config.world import AppearanceConfig
from sim.world.world_files import WorldModel, write_glb, write_obj, write_sdf
from survey import Dem, Grid, InputError

LOOK = AppearanceConfig(debris=0.0)
YAW = np.radians(30.0)


@pytest.fixture(autouse=True)
def small_textures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.world.world_files.MOST_TEXELS", 400)


def world(**changes) -> WorldModel:
    grid = Grid((526000.0, 6478000.0, 526040.0, 6478020.0), 0.5)
    rising = 100.0 + 0.1 * (grid.xy[:, 0] - 526000.0) + 0.02 * (grid.xy[:, 1] - 6478000.0)
    pool = ("melt pool", shapely.box(526030.0, 6478012.0, 526034.0, 6478016.0))
    position = np.array([526010.0, 6478005.0, 101.1])
    parts = {
        "name": "site", "ground": Dem.on(grid, rising.reshape(grid.shape)), "look": LOOK, "wind_from_deg": 235.0,
        "seed": 3, "marks": [pool], "position": position, "quaternion": np.array([0, 0, np.sin(YAW / 2), np.cos(YAW / 2)]),
    }  # fmt: skip
    return WorldModel(**(parts | changes))


def expected_height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height over the spawn position at places relative to it."""
    return 0.1 * x + 0.02 * y


def test_a_height_map_has_the_heights_of_the_terrain(tmp_path: Path) -> None:
    write_sdf(world(), tmp_path / "site.sdf")
    root = ET.parse(tmp_path / "site.sdf").getroot()
    heightmap = root.find("world/model/link/collision/geometry/heightmap")
    size = np.array(heightmap.findtext("size").split(), dtype=float)
    middle = np.array(heightmap.findtext("pos").split(), dtype=float)
    pixels = cv2.imread(str(tmp_path / heightmap.findtext("uri")), cv2.IMREAD_UNCHANGED)
    assert pixels.shape == (129, 129)  # 2⁷ + 1 nodes over 40 m are denser than 0.5 m
    assert (pixels.dtype, pixels.min(), pixels.max()) == (np.uint16, 0, 65535)
    x = middle[0] + np.linspace(-0.5, 0.5, 129) * size[0]
    y = (middle[1] + np.linspace(-0.5, 0.5, 129) * size[1])[::-1]  # the first row lies in the north
    height = middle[2] + pixels / 65535.0 * size[2]
    inside = (y >= -5.0) & (y <= 15.0)
    assert inside.sum() == 65
    expected = expected_height(*np.meshgrid(x, y[inside]))
    np.testing.assert_allclose(height[inside], expected, atol=1e-4)
    # Beyond the terrain the heights of its edge go on.
    np.testing.assert_allclose(height[0], expected_height(x, np.full(129, 15.0)), atol=1e-4)


def test_spawn_pose_place_and_sun_of_a_world(tmp_path: Path) -> None:
    write_sdf(world(), tmp_path / "site.sdf")
    root = ET.parse(tmp_path / "site.sdf").getroot()
    pose = np.array(root.findtext("world/frame[@name='spawn']/pose").split(), dtype=float)
    np.testing.assert_allclose(pose, [0, 0, 0, 0, 0, YAW], atol=1e-8)
    place = root.find("world/spherical_coordinates")
    assert float(place.findtext("latitude_deg")) == pytest.approx(58.442, abs=0.001)
    # East of the central meridian grid north lies east of true north.
    convergence = np.degrees(np.arctan(np.tan(np.radians(-134.5547 + 135.0)) * np.sin(np.radians(58.442))))
    assert float(place.findtext("heading_deg")) == pytest.approx(-convergence, abs=1e-3)
    direction = np.array(root.findtext("world/light/direction").split(), dtype=float)
    assert direction[2] == pytest.approx(-np.sin(np.radians(LOOK.sun_elevation_deg)))
    assert {file.name for file in tmp_path.iterdir()} == {
        "site.sdf", "site.heightmap.png", "site.texture.png", "site.normal.png",
    }  # fmt: skip


def test_a_texture_shows_a_pool_where_it_is() -> None:
    texture = world().texture()[:, :, 0].astype(float)
    n = len(texture)
    assert texture.shape == (n, n)
    per_m = n / 40.0
    # The square reaches from 10 m south of the terrain to 10 m north of it.
    column, row = int(32.0 * per_m), int((30.0 - 14.0) * per_m)
    wet, dry = (
        texture[row - 12 : row + 12, c - 12 : c + 12].mean() for c in (column, column - int(10 * per_m))
    )
    assert wet == pytest.approx(0.25 * dry, rel=0.1)


def glb_parts(path: Path) -> tuple[dict, bytes]:
    content = path.read_bytes()
    assert struct.unpack("<4sII", content[:12]) == (b"glTF", 2, len(content))
    n_text, kind = struct.unpack("<I4s", content[12:20])
    assert kind == b"JSON"
    rest = content[20 + n_text :]
    n_binary, kind = struct.unpack("<I4s", rest[:8])
    assert (kind, n_binary) == (b"BIN\0", len(rest) - 8)
    return json.loads(content[20 : 20 + n_text]), rest[8:]


def test_a_mesh_of_gltf_has_the_nodes_of_the_terrain(tmp_path: Path) -> None:
    write_glb(world(), tmp_path / "site.glb")
    document, binary = glb_parts(tmp_path / "site.glb")

    def part(number: int) -> bytes:
        view = document["bufferViews"][number]
        return binary[view["byteOffset"] :][: view["byteLength"]]

    vertices = np.frombuffer(part(0), "<f4").reshape(-1, 3)
    assert len(vertices) == 81 * 41
    np.testing.assert_allclose(vertices[:, 1], expected_height(vertices[:, 0], -vertices[:, 2]), atol=1e-4)
    triangles = np.frombuffer(part(2), "<u4").reshape(-1, 3)
    assert len(triangles) == 2 * 80 * 40
    sides = np.diff(vertices[triangles], axis=1)
    assert (np.cross(sides[:, 0], sides[:, 1])[:, 1] > 0.0).all()  # faces look up
    picture = cv2.imdecode(np.frombuffer(part(3), np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape[2] == 3
    np.testing.assert_allclose(document["accessors"][0]["min"], vertices.min(axis=0))
    turn = document["nodes"][1]["rotation"]
    np.testing.assert_allclose(turn, [0.0, np.sin(YAW / 2), 0.0, np.cos(YAW / 2)], atol=1e-12)


def test_a_mesh_of_obj_lies_on_its_texture(tmp_path: Path) -> None:
    write_obj(world(), tmp_path / "site.obj")
    rows = [line.split() for line in (tmp_path / "site.obj").read_text().splitlines()]
    vertices, places = (np.array([row[1:] for row in rows if row[0] == key], float) for key in ("v", "vt"))
    np.testing.assert_allclose(vertices[:, 2], expected_height(*vertices[:, :2].T), atol=2e-4)
    # From the south-western corner of the square around the terrain.
    np.testing.assert_allclose(places, (vertices[:, :2] + [10.0, 15.0]) / 40.0, atol=1e-5)
    faces = [row for row in rows if row[0] == "f"]
    assert faces[0] == ["f", "1/1", "82/82", "83/83"]
    assert "map_Kd site.texture.png" in (tmp_path / "site.mtl").read_text()


def test_terrain_with_holes_is_refused() -> None:
    holed = world().ground.elevation.copy()
    holed[3, 4] = np.nan
    with pytest.raises(InputError, match="1 of 3321 cells of the terrain have no height"):
        world(ground=Dem(holed, world().ground.transform, world().ground.crs))


def test_a_texture_of_debris_is_darker_than_snow_and_bright_where_snow_lies() -> None:
    snow, debris, patchy = (
        world(marks=[], surface=surface, snow_cover=share).texture().mean()
        for surface, share in (("snow", 0.0), ("debris", 0.0), ("debris", 0.5))
    )
    assert 0.25 < debris / snow < 0.4
    assert 0.5 < patchy / snow < 0.8
