"""Recorded drives: times of other units, photographs whose positions cannot be used, calibrations of other images, logs."""

import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pyogrio
from PIL import Image, TiffImagePlugin

from benchmarks.bad_input.case import Case, Prepare, Right, both, text

N, ACROSS = 120, 20
HEIGHT_M = 2000.0
_GPS_IFD, _DATE = 0x8825, 0x9003


def place(k: int) -> tuple[float, float]:
    """Return latitude and longitude [deg] of a fix on six lanes."""
    return 46.5 + 4.5e-5 * (k % ACROSS), 8.1 + 1e-4 * (k // ACROSS)


def drive_cases() -> list[Case]:
    """Return recordings whose times, positions, calibrations or vehicles readers mistake."""
    return [
        *_time_cases(),
        *_photo_cases(),
        *_calibration_cases(),
        *_log_cases(),
        *_ulog_cases(),
        *_video_cases(),
    ]


# ---- times -------------------------------------------------------------------------------------------------------------------
_UNITS = {"nanoseconds": 1e9, "microseconds": 1e6, "milliseconds": 1e3}


def _time_cases() -> list[Case]:
    """Return tracks in nano-, micro- and milliseconds: converted and said, or refused."""
    start_s = 1.7e9

    def tum(factor: float) -> str:
        rows = [f"{factor * (start_s + k):.0f} {500_000.0 + k} 6700000 100 0 0 0 1" for k in range(60)]
        return "\n".join([*rows, ""])

    def track(folder: Path, _: str) -> str:
        meta, _index, _raw, columns = pyogrio.raw.read(folder / "out.gpkg")
        times = np.asarray(dict(zip(meta["fields"], columns, strict=True))["time_s"], dtype=np.float64)
        return (
            ""
            if np.isclose(np.median(np.diff(times)), 1.0, rtol=1e-3)
            else f"steps of {np.median(np.diff(times)):g} s, and 1 s was recorded"
        )

    def fixes(factor: float) -> str:
        rows = [
            f"{factor * (start_s + k):.0f},{place(k)[0]:.8f},{place(k)[1]:.8f},{HEIGHT_M},0.5"
            for k in range(N)
        ]
        return "\n".join(["time,lat,lon,alt,sigma_xy", *rows, ""])

    cases = []
    for unit, factor in _UNITS.items():
        export = ["export", "t.tum", "out.gpkg", "--as", "track", "--crs", "EPSG:32608"]
        cases.append(
            Case(
                f"drives: TUM in {unit} · export",
                text("t.tum", tum(factor)),
                export,
                True,
                track,
                ("second", "time"),
            )
        )
        localize = ["localize", "f.csv", "-q", "-o", "out"]
        cases.append(
            Case(
                f"drives: fixes in {unit} · localize",
                text("f.csv", fixes(factor)),
                localize,
                True,
                _lasts(N - 1.0),
            )
        )
    return cases


def _lasts(seconds: float) -> Right:
    """Return a check that a path lasts so long."""

    def right(folder: Path, _: str) -> str:
        rows = np.loadtxt(folder / "out" / "trajectory.tum", comments="#")
        found = rows[-1, 0] - rows[0, 0]
        return (
            ""
            if abs(found - seconds) < 1.0
            else f"the path lasts {found:g} s, and {seconds:g} s were recorded"
        )

    return right


# ---- photographs -------------------------------------------------------------------------------------------------------------
def _photos(change: Callable[[int, dict[int, object]], None]) -> Prepare:
    """Return a preparation that writes six photographs with positions in EXIF that a function changes."""

    def rational(value: float) -> TiffImagePlugin.IFDRational:
        return TiffImagePlugin.IFDRational(round(value * 1_000_000), 1_000_000)

    def angle(value: float) -> tuple[TiffImagePlugin.IFDRational, ...]:
        minutes = 60.0 * (value % 1.0)
        return rational(int(value)), rational(int(minutes)), rational(60.0 * (minutes % 1.0))

    def prepare(folder: Path) -> None:
        (folder / "photos").mkdir()
        rng = np.random.default_rng(1)
        ground = cv2.GaussianBlur(rng.uniform(0, 255, (400, 700)).astype(np.float32), (0, 0), 2.0)
        ground = cv2.normalize(ground, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
        for k in range(6):
            latitude, longitude = 46.5 + 1e-4 * k, 8.1
            gps: dict[int, object] = {
                1: "N", 2: angle(latitude), 3: "E", 4: angle(longitude), 5: b"\x00", 6: rational(700.0 + k),
            }  # fmt: skip
            change(k, gps)
            exif = Image.Exif()
            exif[_GPS_IFD] = {key: value for key, value in gps.items() if value is not None}
            exif[0x8769] = {_DATE: f"2024:05:01 12:00:{10 * k:02d}", 0x920A: rational(4.0), 0xA405: 28}
            Image.fromarray(ground[20 * k : 20 * k + 240, :320]).convert("RGB").save(
                folder / "photos" / f"IMG_{k}.jpg", exif=exif, quality=95
            )

    return prepare


def _photo_cases() -> list[Case]:
    """Return photographs whose positions lack something: named with their number."""

    def without(*keys: int, of: tuple[int, ...] = (1, 3)) -> Callable[[int, dict[int, object]], None]:
        def change(k: int, gps: dict[int, object]) -> None:
            for key in keys if k in of else ():
                gps[key] = None

        return change

    def zero(k: int, gps: dict[int, object]) -> None:
        if k in (1, 3):
            gps[6] = TiffImagePlugin.IFDRational(0, 1)

    def undefined(k: int, gps: dict[int, object]) -> None:
        if k in (1, 3):
            gps[6] = TiffImagePlugin.IFDRational(0, 0)

    kinds = {
        "altitude 0": zero, "no altitude": without(6), "no hemisphere of the latitude": without(1), "no hemisphere of the longitude": without(3),
        "no longitude": without(3, 4), "altitude 0/0": undefined,
    }  # fmt: skip

    def said(_: Path, printed: str) -> str:
        return (
            ""
            if any(
                word in printed for word in ("2 of 6", "2 fixes", "2 photo", "2 image", "2 position", "IMG_1")
            )
            else "nothing says that two positions are left out"
        )

    return [
        Case(
            f"drives: photographs with {what} · localize",
            _photos(change),
            ["localize", "photos", "--dry-run", "-o", "out"],
            True,
            said,
        )
        for what, change in kinds.items()
    ]


# ---- calibrations ------------------------------------------------------------------------------------------------------------
def frames(width: int = 320, height: int = 240) -> Prepare:
    def prepare(folder: Path) -> None:
        images = folder / "drive" / "images"
        images.mkdir(parents=True)
        rng = np.random.default_rng(2)
        ground = cv2.GaussianBlur(
            rng.uniform(0, 255, (height + 60, width + 60)).astype(np.float32), (0, 0), 2.0
        )
        ground = cv2.normalize(ground, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
        for k in range(6):
            cv2.imwrite(str(images / f"{k:06d}.png"), ground[5 * k : 5 * k + height, :width])

    return prepare


def _calibration_cases() -> list[Case]:
    """Return calibrations of images of another size: a note with the factor, or refused."""

    def yaml(factor: float, *, states_size: bool) -> str:
        fx, cx, cy = 300.0 * factor, 160.0 * factor, 120.0 * factor
        size = (
            f"image_width: {round(320 * factor)}\nimage_height: {round(240 * factor)}\n"
            if states_size
            else "image_width: 320\nimage_height: 240\n"
        )
        return (
            f"{size}camera_name: a\ndistortion_model: plumb_bob\n"
            f"camera_matrix: {{rows: 3, cols: 3, data: [{fx}, 0, {cx}, 0, {fx}, {cy}, 0, 0, 1]}}\n"
            "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n"
        )

    def said(_: Path, printed: str) -> str:
        words = ("principal point", "middle", "half", "twice", "factor", "size")
        return (
            ""
            if any(word in printed for word in words)
            else "nothing says that the calibration is of another size"
        )

    args = ["localize", "drive", "--camera", "c.yaml", "--frame-rate", "2", "-q", "-o", "out"]
    return [
        Case(
            f"drives: a calibration of {factor:g} times the size, {'stated' if stated else 'not stated'} · localize",
            both(frames(), text("c.yaml", yaml(factor, states_size=stated))), args, True, said,
        )
        for factor in (0.5, 2.0, 0.25, 4.0)
        for stated in (True, False)
    ]  # fmt: skip


# ---- logs of receivers -------------------------------------------------------------------------------------------------------
def _sentence(body: str) -> str:
    total = 0
    for letter in body.encode():
        total ^= letter
    return f"${body}*{total:02X}\n"


def nmea(quality: int, n: int = N) -> str:
    """Return GGA sentences of fixes of a quality."""
    found = ""
    for k in range(n):
        latitude, longitude = place(k)
        angles = [f"{int(a):0{d}d}{60.0 * (a % 1.0):010.7f}" for a, d in ((latitude, 2), (longitude, 3))]
        clock = f"10{k // 60:02d}{k % 60:02d}.00"
        found += _sentence(
            f"GNGGA,{clock},{angles[0]},N,{angles[1]},E,{quality},20,0.6,{HEIGHT_M:.3f},M,47.0,M,,"
        )
    return found


def ubx(n: int = N) -> bytes:
    """Return NAV-PVT messages."""
    found = b""
    for k in range(n):
        latitude, longitude = place(k)
        body = struct.pack(
            "<IHBBBBBBIiBBBBiiiiIIiiiiiIIHBBBBBBihH", 1000 * k, 2024, 5, 1, 12, k // 60, k % 60, 7, 20, 0, 3, 1, 0, 20,
            round(1e7 * longitude), round(1e7 * latitude), round(1e3 * HEIGHT_M), round(1e3 * (HEIGHT_M - 47.0)), 20, 30,
            0, 0, 0, 0, 0, 100, 1000, 100, 0, 0, 0, 0, 0, 0, 0, 0, 0,
        )  # fmt: skip
        message = b"\x01\x07" + struct.pack("<H", len(body)) + body
        a = b = 0
        for byte in message:
            a = (a + byte) & 0xFF
            b = (b + a) & 0xFF
        found += b"\xb5\x62" + message + bytes([a, b])
    return found


def rtklib(n: int = N) -> str:
    """Return positions of RTKLIB."""
    head = "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)"
    rows = [
        f"2024/05/01 12:{k // 60:02d}:{k % 60:02d}.000 {place(k)[0]:.9f} {place(k)[1]:.9f} {HEIGHT_M} 1 12 0.01 0.01 0.03 0 0 0 0 5"
        for k in range(n)
    ]
    return "\n".join([head, *rows, ""])


def gpx(n: int = N) -> str:
    """Return a GPX track."""
    rows = [
        f'<trkpt lat="{place(k)[0]:.9f}" lon="{place(k)[1]:.9f}"><ele>{HEIGHT_M}</ele>'
        f"<time>2024-05-01T12:{k // 60:02d}:{k % 60:02d}Z</time></trkpt>"
        for k in range(n)
    ]
    name = "http://www.topografix.com/GPX/1/1"
    return f'<gpx version="1.1" creator="x" xmlns="{name}"><trk><trkseg>{"".join(rows)}</trkseg></trk></gpx>'


def grafnav(n: int = N) -> str:
    """Return text of GrafNav with angles in degrees, minutes and seconds."""

    def angle(value: float) -> str:
        rest = 60.0 * (value % 1.0)
        return f"{int(value):3d} {int(rest):02d} {60.0 * (rest % 1.0):08.5f}"

    head = [
        "Project:     demo", "Datum:       WGS84, (processing datum)", "",
        "   Week     GPSTime       Latitude      Longitude      H-Ell  SDEast SDNorth SDHeight Q",
        "(weeks)       (sec)     (+/-D M S)     (+/-D M S)        (m)     (m)     (m)      (m)", "",
    ]  # fmt: skip
    rows = [
        f"   2312  {302418 + k:10.2f}  {angle(place(k)[0])}  {angle(place(k)[1])}  {HEIGHT_M:9.3f}   0.012   0.014    0.031 1"
        for k in range(n)
    ]
    return "\n".join([*head, *rows, ""])


_LOGS: dict[str, tuple[Callable[[int], str | bytes], bool]] = {
    "a.nmea": (lambda n: nmea(4, n), True),
    "b.nmea": (lambda n: nmea(1, n), False),
    "a.ubx": (ubx, True),
    "a.pos": (rtklib, True),
    "a.gpx": (gpx, False),
    "grafnav.txt": (grafnav, True),
    "nmea.txt": (lambda n: nmea(4, n), True),
    "nmea.log": (lambda n: nmea(4, n), True),
}


def _path_only(folder: Path, _: str) -> str:
    out = folder / "out"
    if not (out / "trajectory.csv").exists():
        return "no path was written"
    return "ground points were written below an unknown antenna" if (out / "landmarks.gpkg").exists() else ""


def _ground_is(height_m: float) -> Right:
    def right(folder: Path, _: str) -> str:
        rows = np.genfromtxt(folder / "out" / "landmarks.csv", delimiter=",", names=True, comments=None)
        found = float(np.median(rows["z_m"]))
        return "" if abs(found - height_m) < 0.01 else f"ground at {found:.2f} m, and {height_m:g} m is right"

    return right


def _map_is(height_m: float, least_sigma_m: float) -> Right:
    def right(folder: Path, _: str) -> str:
        import rasterio

        with rasterio.open(folder / "out" / "dem.tif") as source:
            mean, sigma = source.read(1, masked=True), source.read(2, masked=True)
        if abs(float(mean.mean()) - height_m) > 0.2:
            return f"a map at {float(mean.mean()):.2f} m, and {height_m:g} m is right"
        return (
            "" if float(sigma.min()) > least_sigma_m else f"σ {float(sigma.min()):.3f} m of errors that last"
        )

    return right


def _log_cases() -> list[Case]:
    """Return logs of receivers as sources: a path; ground only below a stated antenna; errors stated or asked for."""
    cases = []
    for name, (made, states_errors) in _LOGS.items():
        write = text(name, made(N))
        map_args = ["reconstruct", name, "--grid", "20", "-q", "-o", "out"]
        known = [*map_args, "--antenna", "1.8"]
        cases += [
            Case(f"drives: {name} · localize", write, ["localize", name, "-q", "-o", "out"], True, _path_only),
            Case(f"drives: {name} · localize --antenna", write, ["localize", name, "--antenna", "1.8", "-q", "-o", "out"], True, _ground_is(HEIGHT_M - 1.8)),
            Case(f"drives: {name} · reconstruct", write, map_args, False, None, ("--antenna",)),
            Case(f"drives: {name} with --trajectory · reconstruct", write, [*known, "--trajectory", "t.csv"], False, None, ("--trajectory",)),
            Case(f"drives: {name} of one fix · localize", text(name, made(1)), ["localize", name, "-q", "-o", "out"]),
            Case(f"drives: {name} with --frame-rate · localize", write, ["localize", name, "--frame-rate", "5", "-q"], False, None, ("--frame-rate",)),
        ]  # fmt: skip
        if states_errors:
            cases.append(
                Case(
                    f"drives: {name} · reconstruct --antenna",
                    write,
                    known,
                    True,
                    _map_is(HEIGHT_M - 1.8, 0.005),
                )
            )
        else:
            cases.append(
                Case(f"drives: {name} · reconstruct --antenna", write, known, False, None, ("--sigma",))
            )
            cases.append(
                Case(
                    f"drives: {name} · reconstruct --antenna --sigma",
                    write,
                    [*known, "--sigma", "2"],
                    True,
                    _map_is(HEIGHT_M - 1.8, 0.8),
                )
            )
    return cases


# ---- logs of PX4 -------------------------------------------------------------------------------------------------------------
def ulog(
    receivers: tuple[int, ...] = (N,), vehicle: int = 3, *, landed: bool = True, eph: float = 3.2
) -> bytes:
    """Return a log of PX4: fixes of each receiver, the type of the vehicle, and its land detector."""

    def message(kind: bytes, data: bytes) -> bytes:
        return struct.pack("<HB", len(data), kind[0]) + data

    fields = b"uint64_t timestamp;int32_t lat;int32_t lon;int32_t alt;uint8_t fix_type;float eph;float epv;"
    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message(b"B", bytes(40))
    content += message(b"F", b"sensor_gps:" + fields)
    content += message(b"F", b"vehicle_status:uint64_t timestamp;uint8_t vehicle_type;")
    content += message(b"F", b"vehicle_land_detected:uint64_t timestamp;bool landed;")
    content += message(b"A", struct.pack("<BH", 0, 1) + b"vehicle_status")
    content += message(b"A", struct.pack("<BH", 0, 2) + b"vehicle_land_detected")
    for number in range(len(receivers)):
        content += message(b"A", struct.pack("<BH", number, 10 + number) + b"sensor_gps")
    content += message(b"D", struct.pack("<HQB", 1, 0, vehicle)) + message(
        b"D", struct.pack("<HQ?", 2, 0, landed)
    )
    for k in range(N):
        latitude, longitude = (round(1e7 * angle) for angle in place(k))
        for number, n in enumerate(receivers):
            if k < n:
                row = struct.pack(
                    "<QiiiBff", 1_000_000 * k, latitude, longitude, round(1e3 * HEIGHT_M), 3, eph, 1.5 * eph
                )
                content += message(b"D", struct.pack("<H", 10 + number) + row)
    return content


def _sigma_is(sigma_m: float) -> Right:
    def right(folder: Path, _: str) -> str:
        rows = np.genfromtxt(folder / "out" / "trajectory.csv", delimiter=",", names=True)
        found = float(np.sqrt(np.median(rows["var_xx_m2"])))
        return (
            "" if abs(found - sigma_m) < 0.1 * sigma_m else f"σ {found:.2f} m, and {sigma_m:g} m was logged"
        )

    return right


def _poses_are(n: int) -> Right:
    def right(folder: Path, printed: str) -> str:
        rows = np.loadtxt(folder / "out" / "trajectory.tum", comments="#")
        if len(rows) != n:
            return f"{len(rows)} fixes of {n} are used"
        return "" if "left out" in printed else "nothing says which receivers are left out"

    return right


def _ulog_cases() -> list[Case]:
    localize, ground = (
        ["localize", "a.ulg", "-q", "-o", "out"],
        ["localize", "a.ulg", "--antenna", "1.8", "-q", "-o", "out"],
    )
    mapped = ["reconstruct", "a.ulg", "--antenna", "1.8", "--grid", "20", "-q", "-o", "out"]
    flying: dict[str, tuple[int, bool]] = {
        "a multicopter": (1, True),
        "fixed wings": (2, True),
        "an airship": (4, True),
        "a vehicle in the air": (0, False),
    }
    cases = []
    for what, (vehicle, landed) in flying.items():
        write = text("a.ulg", ulog(vehicle=vehicle, landed=landed))
        cases += [
            Case(f"drives: log of {what} · localize", write, localize, True, _path_only),
            Case(f"drives: log of {what} · localize --antenna", write, ground, False, None, ("--antenna",)),
            Case(f"drives: log of {what} · reconstruct", write, mapped, False, None, ("--antenna", "log of")),
        ]
    for sigma_m in (0.02, 3.2, 10.0):
        cases.append(
            Case(
                f"drives: log with eph {sigma_m:g} m · localize",
                text("a.ulg", ulog(eph=sigma_m)),
                localize,
                True,
                _sigma_is(sigma_m),
            )
        )
    for counts in ((2, 30), (30, 2), (2, 30, 10), (0, 30)):
        cases.append(
            Case(
                f"drives: log with fixes {counts} of receivers · localize",
                text("a.ulg", ulog(counts)),
                localize,
                True,
                _poses_are(30) if 0 not in counts else None,
            )
        )
    cases.append(
        Case(
            "drives: log of a rover · reconstruct",
            text("a.ulg", ulog()),
            mapped,
            True,
            _map_is(HEIGHT_M - 1.8, 2.0),
        )
    )
    cases.append(Case("drives: log without fixes · localize", text("a.ulg", ulog((0,))), localize))
    return cases


def _video_cases() -> list[Case]:
    return [
        Case(
            f"drives: {name} · localize",
            text(name, bytes(2_000)),
            ["localize", name, "-q"],
            False,
            None,
            ("ffmpeg",),
        )
        for name in ("a.mp4", "GX010042.MP4", "a.mov", "a.avi", "my drive.mkv", "a.webm")
    ]
