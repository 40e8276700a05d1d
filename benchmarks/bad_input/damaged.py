"""Damaged files of other programs: flipped and missing bytes in every container, deep JSON, rasters that name themselves, small limits."""

import io
import json
import resource
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow
import pyogrio
import shapely
from pyarrow import parquet
from scipy.io import netcdf_file

from benchmarks.bad_input.case import Case, Prepare, both, text
from benchmarks.bad_input.drives import ulog
from benchmarks.bad_input.good import SOUTH, UTM, WEST, area, hills, points, raster
from benchmarks.bad_input.outlines import SITE, features
from benchmarks.bad_input.surveys import las, terrain

_LOGS = 2
"""Files that the runner opens for a case after its preparation."""


def damaged_cases() -> list[Case]:
    """Return damaged files, which end in one sentence or, where the damage lies in what is not read, in a result."""
    return [*_flip_cases(), *_deep_cases(), *_loop_cases(), *_limit_cases()]


def _fgb(path: Path) -> None:
    shapes = np.array([shapely.to_wkb(SITE)], dtype=object)
    name = [np.array(["site"], dtype=object)]
    pyogrio.raw.write(path, shapes, field_data=name, fields=["name"], geometry_type="Polygon", crs=UTM)


def _bag(path: Path) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    header = kinds["std_msgs/msg/Header"]
    stamp = kinds["builtin_interfaces/msg/Time"]
    with Writer(path) as writer:
        images = writer.add_connection("/image", "sensor_msgs/msg/Image", typestore=store)
        infos = writer.add_connection("/info", "sensor_msgs/msg/CameraInfo", typestore=store)
        region = kinds["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        pixels = np.random.default_rng(1).integers(0, 255, 48 * 64, dtype=np.uint8)
        matrix = np.array([50.0, 0, 32, 0, 50, 24, 0, 0, 1])
        for k in range(4):
            at = header(k, stamp(100 + k, 0), "camera")
            image = kinds["sensor_msgs/msg/Image"](at, 48, 64, "mono8", 0, 64, pixels)
            info = kinds["sensor_msgs/msg/CameraInfo"](
                at, 48, 64, "plumb_bob", np.zeros(5), matrix, np.eye(3).ravel(), np.append(matrix.reshape(3, 3), np.zeros((3, 1)), 1).ravel(), 0, 0, region
            )  # fmt: skip
            writer.write(images, (100 + k) * 10**9, store.serialize_ros1(image, "sensor_msgs/msg/Image"))
            writer.write(infos, (100 + k) * 10**9, store.serialize_ros1(info, "sensor_msgs/msg/CameraInfo"))


def _mcap(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        kind = writer.register_schema("foxglove.CompressedImage", "jsonschema", b"{}")
        channel = writer.register_channel("/image", "json", kind)
        for k in range(20):
            writer.add_message(
                channel,
                k * 10**9,
                json.dumps({"frame_id": "a", "data": "", "format": "png"}).encode(),
                k * 10**9,
            )
        writer.finish()


def _hgt(path: Path) -> None:
    heights = np.tile(np.linspace(700, 900, 1201), (1201, 1)).astype(">i2")
    path.write_bytes(heights.tobytes())


def _netcdf(path: Path) -> None:
    with netcdf_file(path, "w") as file:
        for name, start in (("y", SOUTH), ("x", WEST)):
            file.createDimension(name, 50)
            axis = file.createVariable(name, "f8", (name,))
            axis[:] = start + 3.0 * np.arange(50)
            axis.units, axis.standard_name = "m", f"projection_{name}_coordinate"
        band = file.createVariable("z", "f4", ("y", "x"))
        band[:] = hills()
        band.units = "m"


def _parquet(path: Path) -> None:
    columns = dict(zip("xyz", terrain().T, strict=True))
    table = pyarrow.table(columns).replace_schema_metadata({"crs": UTM})
    parquet.write_table(table, path)


def _tiff(path: Path) -> None:
    raster(path.name)(path.parent)


def _yaml(path: Path) -> None:
    path.write_text(
        "image_width: 320\nimage_height: 240\ndistortion_model: plumb_bob\n"
        "camera_matrix: {rows: 3, cols: 3, data: [300, 0, 160, 0, 300, 120, 0, 0, 1]}\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n"
    )


def _laz(path: Path) -> None:
    las(path.name, 4099, 9001, 1.0)(path.parent)


def _kmz(path: Path) -> None:
    from benchmarks.bad_input.outlines import HOLES, google_earth, kmz

    kmz(google_earth(HOLES[:1]))(path.parent)
    (path.parent / "site.kmz").rename(path)


_PRIOR = ["plan", "area.gpkg", "--prior"]
_CONTAINERS: dict[str, tuple[str, Callable[[Path], None], list[str], Prepare | None]] = {
    "FlatGeobuf": ("d.fgb", _fgb, ["plan", "d.fgb", "--spacing", "60", "-q"], None),
    "ROS bag": ("d.bag", _bag, ["localize", "d.bag", "-q", "-o", "out"], None),
    "MCAP": ("d.mcap", _mcap, ["localize", "d.mcap", "-q", "-o", "out"], None),
    "ULog": ("d.ulg", lambda path: path.write_bytes(ulog()) and None, ["localize", "d.ulg", "-q", "-o", "out"], None),
    "HGT": ("N60W136.hgt", _hgt, ["export", "N60W136.hgt", "out.tif"], None),
    "NetCDF": ("d.nc", _netcdf, ["export", "d.nc", "out.tif", "--crs", UTM], None),
    "GeoTIFF": ("d.tif", _tiff, [*_PRIOR, "d.tif", "-q"], area),
    "Parquet": ("d.parquet", _parquet, ["reconstruct", "d.parquet", "--tiles", "--grid", "2", "--sigma", "0.1", "--workers", "1", "-q", "-o", "out"], None),
    "LAZ": ("d.laz", _laz, ["reconstruct", "d.laz", "--sigma", "0.1", "--grid", "15", "-q", "-o", "out"], None),
    "YAML": ("d.yaml", _yaml, ["localize", "drive", "--camera", "d.yaml", "--frame-rate", "2", "--dry-run"], None),
    "KMZ": ("d.kmz", _kmz, ["export", "d.kmz", "out.gpkg", "--as", "area"], None),
}  # fmt: skip


def _spoilt(
    write: Callable[[Path], None], name: str, spoil: Callable[[bytes], bytes], beside: Prepare | None
) -> Prepare:
    def prepare(folder: Path) -> None:
        if beside is not None:
            beside(folder)
        if name == "d.yaml":
            from benchmarks.bad_input.drives import frames

            frames()(folder)
        write(folder / name)
        (folder / name).write_bytes(spoil((folder / name).read_bytes()))

    return prepare


def _spoils() -> dict[str, Callable[[bytes], bytes]]:
    """Return ways to damage the bytes of a file, the same ones for every container."""

    def flipped(share: float, mask: int) -> Callable[[bytes], bytes]:
        def spoil(raw: bytes) -> bytes:
            at = min(int(share * len(raw)), len(raw) - 1)
            return raw[:at] + bytes([raw[at] ^ mask]) + raw[at + 1 :]

        return spoil

    rng = np.random.default_rng(52)

    def sprinkled(seed: int) -> Callable[[bytes], bytes]:
        def spoil(raw: bytes) -> bytes:
            content = bytearray(raw)
            for at in np.random.default_rng(seed).integers(0, len(raw), max(len(raw) // 500, 3)):
                content[at] ^= 0x55
            return bytes(content)

        return spoil

    found = {
        f"a bit flipped at {100 * share:.0f} %": flipped(share, int(mask))
        for share, mask in zip((0.02, 0.2, 0.5, 0.8, 0.97), 1 << rng.integers(0, 8, 5), strict=True)
    }
    found |= {f"bytes changed, {seed}": sprinkled(seed) for seed in (1, 2)}
    found |= {
        "the half": lambda raw: raw[: len(raw) // 2],
        "the last bytes gone": lambda raw: raw[:-7],
        "nothing": lambda _: b"",
    }
    return found | {
        "zeros behind the middle": lambda raw: raw[: len(raw) // 2] + bytes(len(raw) - len(raw) // 2)
    }


def _flip_cases() -> list[Case]:
    return [
        Case(f"damaged: {kind}, {what} · {args[0]}", _spoilt(write, name, spoil, beside), args, True)
        for kind, (name, write, args, beside) in _CONTAINERS.items()
        for what, spoil in _spoils().items()
    ]


def _deep_cases() -> list[Case]:
    """Return JSON of many levels at every reader of JSON."""
    cases = []
    for levels in (1_500, 200_000):
        nested = "[" * levels + "]" * levels
        mapping = '{"a":' * levels + "1" + "}" * levels
        files: dict[str, tuple[str, str, list[str]]] = {
            "plan": (
                "d.plan",
                '{"fileType": "Plan", "mission": ' + nested + "}",
                ["export", "d.plan", "out.geojson"],
            ),
            "geojson": (
                "d.geojson",
                features([SITE]).replace('"properties": {}', f'"properties": {{"a": {mapping}}}'),
                ["plan", "d.geojson", "-q"],
            ),
            "geojson of coordinates": (
                "d.geojson",
                f'{{"type": "Polygon", "coordinates": {nested}}}',
                ["plan", "d.geojson", "-q"],
            ),
            "log of a watch": (
                "d.jsonl",
                '{"in": ' + nested + "}\n",
                ["watch", "--replay", "d.jsonl", "--log", "again.jsonl"],
            ),
            "recording": ("recording.json", '{"crs": ' + nested + "}", ["localize", ".", "-q", "-o", "out"]),
        }
        cases += [
            Case(f"damaged: JSON of {levels:,} levels, {kind} · {args[0]}", text(name, content), args)
            for kind, (name, content, args) in files.items()
        ]
    return cases


def _vrt(source: str) -> str:
    return (
        f'<VRTDataset rasterXSize="50" rasterYSize="50"><SRS>{UTM}</SRS><GeoTransform>{WEST},3,0,{SOUTH + 150},0,-3</GeoTransform>'
        f'<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="1">{source}</SourceFilename>'
        "<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"
    )


def _loop_cases() -> list[Case]:
    rings: dict[str, list[str]] = {
        "itself": ["a.vrt"],
        "one that names it": ["a.vrt", "b.vrt"],
        "a ring of three": ["a.vrt", "b.vrt", "c.vrt"],
        "its overview": ["a.vrt"],
    }
    commands: dict[str, tuple[list[str], Prepare]] = {
        "export": (["export", "a.vrt", "out.tif"], both()),
        "plan --prior": ([*_PRIOR, "a.vrt", "-q"], area),
        "score --truth": (["score", "map.tif", "--truth", "a.vrt", "-q"], raster("map.tif")),
        "reconstruct --prior": (
            ["reconstruct", "points.csv", "--crs", UTM, "--prior", "a.vrt", "-q"],
            points,
        ),
    }
    cases = []
    for what, ring in rings.items():
        files = [
            text(name, _vrt(ring[(k + 1) % len(ring)] if what != "its overview" else "./a.vrt"))
            for k, name in enumerate(ring)
        ]
        cases += [
            Case(f"damaged: a VRT of {what} · {command}", both(beside, *files), args)
            for command, (args, beside) in commands.items()
        ]
    return cases


def _limit_cases() -> list[Case]:
    """Return cases of small limits of the process, which the refusal has to name."""

    def limited(which: int, most: int) -> Prepare:
        def prepare(_: Path) -> None:
            n = len(list(Path("/proc/self/fd").iterdir())) + _LOGS if which == resource.RLIMIT_NOFILE else 0
            resource.setrlimit(which, (n + most, n + most))

        return prepare

    def large(folder: Path) -> None:
        with io.BytesIO() as content:
            np.savetxt(
                content,
                np.random.default_rng(1).uniform(0, 150, (300_000, 4)) + [WEST, SOUTH, 100.0, 0.1],
                delimiter=",",
                fmt="%.3f",
            )
            (folder / "points.csv").write_bytes(b"x_m,y_m,z_m,sigma_z_m\n" + content.getvalue())

    many = ["reconstruct", "points.csv", "--crs", UTM, "--grid", "1", "-q", "-o", "out"]
    export = ["export", "dem.tif", "out.asc"]
    files = {
        "export": (raster("dem.tif"), export),
        "reconstruct": (points, many),
        "plan": (area, ["plan", "area.gpkg", "-q"]),
    }
    return [
        Case(
            f"damaged: {most} more open files · {command}",
            both(beside, limited(resource.RLIMIT_NOFILE, most)),
            args,
            True,
        )
        for most in (1, 4, 12)
        for command, (beside, args) in files.items()
    ] + [
        Case(
            f"damaged: {most / 1e9:g} GB of addresses · reconstruct",
            both(large, limited(resource.RLIMIT_AS, int(most))),
            many,
            True,
        )
        for most in (1.5e9, 2.5e9)
    ]
