"""Write the ground of a site for other simulators: SDF with a height map (Gazebo), glTF 2.0 and OBJ, each with a texture.

Coordinates are metres from the spawn pose, x east, y north, z up; glTF has y up as its standard wants. A height map of
Gazebo is a square of 2ⁿ + 1 nodes: beyond the terrain the square goes on at the height of the edge.
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import shapely
from affine import Affine
from pyproj import CRS, Geod
from rasterio.features import rasterize
from scipy.spatial.transform import Rotation

from sim.config.world import AppearanceConfig
from sim.world.appearance import (
    ROUGH_ALBEDO,
    SURFACE_TEXEL_M,
    Tile,
    downhill_rad,
    rough_tile,
    snow_on_rough_ground,
    snow_patches,
    sun_direction,
    surface_tile,
)
from sim.world.hazards import FloatGrid
from survey import Dem, InputError
from survey.core import FloatArray, IntArray, replacing, write_text
from survey.core.transformation import transformed
from survey.data.frames import Image

MOST_NODES, MOST_TEXELS, MOST_VERTICES = 4097, 4096, 2**18
"""Sides of a height map and of a texture, and vertices of a mesh, that simulators still load at once."""
_SNOW_GREY = 217.0
# Reflectance as a share of that of clean snow.
_TONES = {"melt pool": 0.25, "melt channel": 0.6, "crevasse": 0.8, "dirt cone": 0.45}
_LEVELS = 65535


@dataclass(frozen=True)
class WorldModel:
    """Ground, look and spawn pose of a site.

    `name`: of the world. `ground`: heights of every cell. `look`, `wind_from_deg`, `seed`: as images are rendered.
    `marks`: kinds and outlines of hazards, which have tones of their own. `position` (3,), `quaternion` (4,): spawn
    pose in the CRS of the ground [m], as x, y, z, w. `surface`, `snow_cover`: as in `SceneryConfig`.
    """

    name: str
    ground: Dem
    look: AppearanceConfig
    wind_from_deg: float
    seed: int
    marks: Sequence[tuple[str, shapely.Geometry]]
    position: FloatArray
    quaternion: FloatArray
    surface: str = "snow"
    snow_cover: float = 0.0

    def __post_init__(self) -> None:
        n_unknown = int((~np.isfinite(self.ground.elevation)).sum())
        if n_unknown:
            raise InputError(
                f"{n_unknown} of {self.ground.elevation.size} cells of the terrain have no height, and a world has no "
                "holes; simulate on an area without them."
            )

    @cached_property
    def side_m(self) -> float:
        """Side of the square around the terrain [m]."""
        west, south, east, north = self.ground.grid().bounds
        return float(max(east - west, north - south))

    @cached_property
    def corner(self) -> FloatArray:
        """South-western corner of the square [m], in the CRS."""
        west, south, east, north = self.ground.grid().bounds
        return 0.5 * (np.array([west + east, south + north]) - self.side_m)

    def heights(self) -> FloatArray:
        """Return the heights (2ⁿ + 1, 2ⁿ + 1) of the square [m], the first row in the north, as dense as the terrain."""
        n = min(2 ** int(np.ceil(np.log2(self.side_m / self.ground.step_m - 1e-9))) + 1, MOST_NODES)
        x, y = self.corner[:, None] + np.linspace(0.0, self.side_m, n)
        west, south, east, north = self.ground.grid().bounds
        xy = np.meshgrid(x.clip(west, east), y[::-1].clip(south, north))
        return self.ground.at(np.column_stack([part.ravel() for part in xy])).reshape(n, n)

    def texture(self) -> Image:
        """Return the reflectance of the square (T, T, 3), the first row in the north; light and shade are not in it."""
        texel_m = max(self.side_m / MOST_TEXELS, SURFACE_TEXEL_M)
        n = round(self.side_m / texel_m)
        west, _, _, north = self.ground.grid().bounds
        offset = (np.arange(n) + 0.5) * self.side_m / n
        x, down = self.corner[0] + offset - west, north - (self.corner[1] + self.side_m - offset)
        patches = snow_patches(self.ground.shape, self.ground.step_m, self.look, self.seed)
        columns, rows = (np.asarray(part / self.ground.step_m, dtype=np.float32) for part in (x, down))
        at = np.meshgrid(columns, rows)
        share = 1.0 + _sampled(surface_tile(self.look, self.wind_from_deg, self.seed), x, -down, texel_m)
        if self.surface != "snow":
            height = self.ground.elevation.astype(np.float32)
            snow = _at_nodes(snow_on_rough_ground(height, self.ground.step_m, self.snow_cover, self.seed), at)
            tile = rough_tile(self.surface, self.look, downhill_rad(height), self.seed)
            rough = ROUGH_ALBEDO[self.surface] * (1.0 + _sampled(tile, x, -down, texel_m))
            share = rough + snow * (share - rough)
        share *= _at_nodes(patches, at) * self._tones(n)
        grey = np.clip(np.rint(_SNOW_GREY * share), 0.0, 255.0).astype(np.uint8)
        return np.repeat(grey[:, :, None], 3, axis=2)

    def _tones(self, n: int) -> FloatGrid:
        """Return the reflectance (n, n) of hazards as a share of that around them."""
        marked = [(outline, _TONES[kind]) for kind, outline in self.marks if kind in _TONES]
        scale = self.side_m / n
        place = Affine(scale, 0.0, self.corner[0], 0.0, -scale, self.corner[1] + self.side_m)
        if not marked:
            return np.ones((1, 1), np.float32)
        tones: FloatGrid = rasterize(marked, (n, n), fill=1.0, transform=place, dtype="float32")
        return tones

    def mesh(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return vertices (N, 3) from the spawn position [m], their place in the texture (N, 2), and triangles (M, 3).

        Places in the texture count from its north-western corner to the right and down, from 0 to 1. Where the terrain
        has more than `MOST_VERTICES` nodes, every second, third … one is a vertex.
        """
        ground = self.ground
        every = int(np.ceil(np.sqrt(ground.elevation.size / MOST_VERTICES)))
        rows, columns = (np.unique(np.r_[: n - 1 : every, n - 1]) for n in ground.shape)
        x, y = np.meshgrid(ground.x[columns], ground.y[rows])
        place = np.column_stack([x.ravel(), y.ravel(), ground.elevation[np.ix_(rows, columns)].ravel()])
        on_texture = (place[:, :2] - self.corner) / self.side_m
        on_texture[:, 1] = 1.0 - on_texture[:, 1]
        node = np.arange(len(rows) * len(columns)).reshape(len(rows), len(columns))
        north_west, north_east = node[:-1, :-1].ravel(), node[:-1, 1:].ravel()
        south_west, south_east = node[1:, :-1].ravel(), node[1:, 1:].ravel()
        halves = [(north_west, south_west, south_east), (north_west, south_east, north_east)]
        triangles = np.stack([np.column_stack(half) for half in halves], axis=1).reshape(-1, 3)
        return place - self.position, on_texture, triangles


def _at_nodes(grid: FloatGrid, at: Sequence[FloatGrid]) -> FloatGrid:
    """Interpolate a grid at columns and rows."""
    found = cv2.remap(grid, at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32)


def _sampled(tile: Tile, x: FloatArray, y: FloatArray, texel_m: float) -> FloatGrid:
    """Return the relative change of brightness (len(y), len(x)) of a tile, from the level of that texel."""
    level = int(np.clip(np.floor(np.log2(texel_m * tile.texels_per_m) + 1e-9), 0, len(tile.starts) - 1))
    side, per_m = tile.texels >> level, tile.texels_per_m / 2**level
    words = tile.words[tile.starts[level] :][: side * side].reshape(side, side)
    column, row = (np.floor(part * per_m).astype(np.int64) % side for part in (x, y))
    texture: FloatGrid = ((words & np.uint32(255)).astype(np.float32) - 128.0) * np.float32(tile.amplitude)
    return texture[np.ix_(row, column)]


def write_sdf(world: WorldModel, path: str | Path) -> str:
    """Write a world of SDF 1.9, and beside it height map (16 bit), texture and normals; return what was written.

    The frame ``spawn`` holds the spawn pose. Latitude, longitude and the angle from east to the x axis are those of
    the origin.
    """
    heights = world.heights()
    low, high = float(heights.min()), float(heights.max())
    pixels = np.rint((heights - low) / max(high - low, 1e-9) * _LEVELS).astype(np.uint16)
    with replacing(path) as draft:
        for part, image in (
            ("heightmap", pixels),
            ("texture", world.texture()),
            ("normal", np.full((4, 4, 3), (255, 128, 128), np.uint8)),
        ):
            draft.with_suffix(f".{part}.png").write_bytes(_png(image))
        write_text(draft, _sdf(world, Path(path).stem, low, max(high - low, 1e-3)))
    step_m = world.side_m / (len(heights) - 1)
    return f"height map of {len(heights)} × {len(heights)} nodes, {step_m:.3g} m apart"


def _sdf(world: WorldModel, stem: str, low_m: float, relief_m: float) -> str:
    """Return the text of a world whose height map spans heights from the lowest one on [m]."""
    longitude, latitude, heading_deg = _geographic(world)
    middle = world.corner + 0.5 * world.side_m - world.position[:2]
    turn = Rotation.from_quat(world.quaternion).as_euler("xyz")
    sun = -sun_direction(world.look)
    sky = world.look.sky_share
    geometry = (
        f"<heightmap><uri>{stem}.heightmap.png</uri><size>{world.side_m!r} {world.side_m!r} {relief_m!r}</size>"
        f"<pos>{_spaced([*middle, low_m - world.position[2]])}</pos>"
    )
    texture = (
        f"<texture><size>{world.side_m!r}</size><diffuse>{stem}.texture.png</diffuse>"
        f"<normal>{stem}.normal.png</normal></texture>"
    )
    return f"""<?xml version="1.0"?>
<!-- The origin is at {_spaced(world.position)} m in {world.ground.crs.name}. -->
<sdf version="1.9">
  <world name="{world.name}">
    <spherical_coordinates>
      <surface_model>EARTH_WGS84</surface_model>
      <world_frame_orientation>ENU</world_frame_orientation>
      <latitude_deg>{latitude!r}</latitude_deg>
      <longitude_deg>{longitude!r}</longitude_deg>
      <elevation>{float(world.position[2])!r}</elevation>
      <heading_deg>{heading_deg!r}</heading_deg>
    </spherical_coordinates>
    <scene>
      <ambient>{sky:g} {sky:g} {sky:g} 1</ambient>
      <background>0.8 0.85 0.9 1</background>
    </scene>
    <light name="sun" type="directional">
      <cast_shadows>true</cast_shadows>
      <diffuse>{1.0 - sky:g} {1.0 - sky:g} {1.0 - sky:g} 1</diffuse>
      <specular>0 0 0 1</specular>
      <direction>{_spaced(sun)}</direction>
    </light>
    <frame name="spawn"><pose>0 0 0 {_spaced(turn)}</pose></frame>
    <model name="ground">
      <static>true</static>
      <link name="link">
        <collision name="collision"><geometry>{geometry}</heightmap></geometry></collision>
        <visual name="visual"><geometry>{geometry}{texture}</heightmap></geometry></visual>
      </link>
    </model>
  </world>
</sdf>
"""


def _geographic(world: WorldModel) -> tuple[float, float, float]:
    """Return longitude and latitude of the origin [deg], and the angle from east to the x axis, counter-clockwise [deg]."""
    ends = world.position[:2] + np.array([[0.0, 0.0], [0.0, 100.0]])
    (longitude, latitude), (there_lon, there_lat) = transformed(
        ends, world.ground.crs, CRS.from_epsg(4326), "the spawn pose"
    ).tolist()
    north_deg, _, _ = Geod(ellps="WGS84").inv(longitude, latitude, there_lon, there_lat)
    return longitude, latitude, -float(north_deg)


def write_glb(world: WorldModel, path: str | Path) -> str:
    """Write a mesh with its texture, and a node ``spawn``, as binary glTF 2.0; return what was written."""
    place, on_texture, triangles = world.mesh()
    upright = _y_up(place).astype("<f4")
    parts = [upright.tobytes(), on_texture.astype("<f4").tobytes(), triangles.astype("<u4").tobytes()]
    parts.append(_png(world.texture()))
    padded = [part + b"\0" * (-len(part) % 4) for part in parts]
    starts = np.cumsum([0, *map(len, padded)]).tolist()
    x, y, z, w = world.quaternion.tolist()
    document = {
        "asset": {"version": "2.0", "generator": "firnline"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"name": "ground", "mesh": 0}, {"name": "spawn", "rotation": [x, z, -y, w]}],
        "meshes": [
            {
                "name": world.name,
                "primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}],
            }
        ],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0}}
        ],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "count": len(place), "type": "VEC3",
                "min": upright.min(axis=0).tolist(), "max": upright.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5126, "count": len(place), "type": "VEC2"},
            {"bufferView": 2, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(part)} | target
            for start, part, target in zip(
                starts, parts, ({"target": 34962}, {"target": 34962}, {"target": 34963}, {}), strict=False
            )
        ],
        "buffers": [{"byteLength": starts[-1]}],
        "extras": {"crs": world.ground.crs.to_wkt(), "origin_m": world.position.tolist()},
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = [struct.pack("<I4s", len(text), b"JSON") + text, struct.pack("<I4s", starts[-1], b"BIN\0")]
    with replacing(path) as draft, draft.open("wb") as stream:
        size = 12 + sum(map(len, chunks)) + starts[-1]
        stream.writelines([struct.pack("<4sII", b"glTF", 2, size), *chunks, *padded])
    return f"mesh of {len(place)} vertices"


def write_obj(world: WorldModel, path: str | Path) -> str:
    """Write a mesh as OBJ, z up, with its material and texture beside it; return what was written."""
    place, on_texture, triangles = world.mesh()
    stem = Path(path).stem
    with replacing(path) as draft:
        draft.with_suffix(".texture.png").write_bytes(_png(world.texture()))
        write_text(
            draft.with_suffix(".mtl"), f"newmtl ground\nKd 1 1 1\nKs 0 0 0\nmap_Kd {stem}.texture.png\n"
        )
        with draft.open("w", encoding="utf-8") as stream:
            stream.write(
                f"# x east, y north, z up [m], from {_spaced(world.position)} in {world.ground.crs.name}\n"
            )
            stream.write(f"mtllib {stem}.mtl\nusemtl ground\n")
            np.savetxt(stream, place, "v %.4f %.4f %.4f")
            np.savetxt(stream, np.column_stack([on_texture[:, 0], 1.0 - on_texture[:, 1]]), "vt %.6f %.6f")
            np.savetxt(stream, np.repeat(triangles + 1, 2, axis=1), "f %d/%d %d/%d %d/%d")
    return f"mesh of {len(place)} vertices"


def _y_up(place: FloatArray) -> FloatArray:
    """Return places (N, 3) east, north, up as x east, y up, z south."""
    return np.column_stack([place[:, 0], place[:, 2], -place[:, 1]])


def _png(image: npt.NDArray[Any]) -> bytes:
    is_encoded, content = cv2.imencode(".png", image)
    if not is_encoded:
        raise InputError("a picture of the world could not be written as PNG.")
    return content.tobytes()


def _spaced(values: Sequence[float] | FloatArray) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)
