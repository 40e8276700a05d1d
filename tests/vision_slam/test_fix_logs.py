"""Logs of receivers alone are paths with their errors, and ground below a stated antenna."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import SurfacePoints
from survey.data.dem import Dem
from vision_slam.readers.gps_files import is_receiver_log, read_gps

N, ACROSS = 120, 20
HEIGHT_M, SIGMA_Z_M = 2000.0, 0.03


def place(k: int) -> tuple[float, float]:
    return 46.5 + 4.5e-5 * (k % ACROSS), 8.1 + 1e-4 * (k // ACROSS)


def in_sentences(quality: int) -> str:
    text = ""
    for k in range(N):
        (latitude, longitude), clock = place(k), f"10{k // 60:02d}{k % 60:02d}.00"
        angles = [f"{int(a):0{n}d}{60.0 * (a % 1.0):010.7f}" for a, n in ((latitude, 2), (longitude, 3))]
        body = f"GNGGA,{clock},{angles[0]},N,{angles[1]},E,{quality},20,0.6,{HEIGHT_M:.3f},M,47.0,M,,"
        total = 0
        for letter in body.encode():
            total ^= letter
        text += f"${body}*{total:02X}\n"
    return text


def in_positions() -> str:
    rows = [
        f"2024/05/01 12:{k // 60:02d}:{k % 60:02d}.000 {place(k)[0]:.9f} {place(k)[1]:.9f} {HEIGHT_M} 1 12 0.01 0.01 {SIGMA_Z_M} 0 0 0 0 5"
        for k in range(N)
    ]
    head = "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)"
    return "\n".join([head, *rows, ""])


def in_track() -> str:
    rows = [
        f'<trkpt lat="{place(k)[0]:.9f}" lon="{place(k)[1]:.9f}"><ele>{HEIGHT_M}</ele>'
        f"<time>2024-05-01T12:{k // 60:02d}:{k % 60:02d}Z</time></trkpt>"
        for k in range(N)
    ]
    name = "http://www.topografix.com/GPX/1/1"
    return f'<gpx version="1.1" creator="x" xmlns="{name}"><trk><trkseg>{"".join(rows)}</trkseg></trk></gpx>'


def in_grafnav(*, minutes: bool = True, height: str = "(m)") -> str:
    """Return text of GrafNav, with angles in degrees, minutes and seconds or in degrees."""

    def angle(value: float) -> str:
        if not minutes:
            return f"{value:14.9f}"
        rest = 60.0 * (value % 1.0)
        return f"{int(value):3d} {int(rest):02d} {60.0 * (rest % 1.0):08.5f}"

    unit = "(+/-D M S)" if minutes else "     (deg)"
    head = [
        "Project:     demo",
        "Datum:       NAD83(CSRS), (processing datum)",
        "",
        "   Week     GPSTime       Latitude      Longitude      H-Ell  SDEast SDNorth SDHeight Q",
        f"(weeks)       (sec)     {unit}     {unit}   {height:>8}     (m)     (m)      (m)",
        "",
    ]
    rows = [
        f"   2312  {302418 + k:10.2f}  {angle(place(k)[0])}  {angle(place(k)[1])}  {HEIGHT_M:9.3f}   0.012   0.014    {SIGMA_Z_M} 1"
        for k in range(N)
    ]
    return "\n".join([*head, *rows, ""])


LOGS = {
    "a.nmea": (in_sentences(4), True),
    "b.nmea": (in_sentences(1), False),
    "a.pos": (in_positions(), True),
    "a.gpx": (in_track(), False),
    "a.txt": (in_grafnav(), True),
    "b.txt": (in_grafnav(minutes=False), True),
    "c.txt": (in_sentences(4), True),
}


def run(*args: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    return result.exit_code, result.output


@pytest.fixture(params=LOGS)
def log(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    (tmp_path / request.param).write_text(LOGS[request.param][0])
    return tmp_path / request.param


def test_fixes_are_the_path_and_the_ground_only_below_a_stated_antenna(log: Path) -> None:
    out = log.parent / "out"
    code, words = run("localize", log, "-o", out, "-q")
    assert code == 0, words
    assert "--antenna" in words
    assert (out / "trajectory.csv").exists()
    assert not (out / "landmarks.gpkg").exists()
    code, words = run("localize", log, "--antenna", "1.8", "-o", out, "--force", "-q")
    assert code == 0, words
    assert "--trajectory" in words
    points = SurfacePoints.read(out / "landmarks.gpkg")
    np.testing.assert_allclose(points.xyz[:, 2], HEIGHT_M - 1.8, atol=1e-6)


def test_a_map_of_fixes_needs_antenna_and_errors(log: Path) -> None:
    out, states_errors = log.parent / "map", LOGS[log.name][1]
    code, words = run("reconstruct", log, "-o", out, "-q")
    assert code == 3
    assert "--antenna" in words
    known = ["reconstruct", log, "--antenna", "1.8", "--grid", "20", "-o", out, "-q"]
    if not states_errors:
        code, words = run(*known)
        assert code == 3
        assert "--sigma" in words
        known += ["--sigma", "2.0"]
    code, words = run(*known)
    assert code == 0, words
    record = json.loads((out / "reconstruction.json").read_text())
    assert any("works in" in note for note in record["diagnostics"]["notes"])
    height, sigma = Dem.read(out / "dem.tif").elevation, Dem.read(out / "dem.tif", band=2).elevation
    np.testing.assert_allclose(height, HEIGHT_M - 1.8, atol=0.1)
    least_m = 1.0 if not states_errors else 0.5 * SIGMA_Z_M
    assert np.nanmin(sigma) > least_m  # the error of one receiver does not average out


def test_grafnav_states_time_height_and_errors(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_text(in_grafnav())
    found = read_gps(file)
    assert found.time_s[0] == 1714564800.0  # 1 May 2024, 12 h
    np.testing.assert_allclose(found.place[:, 1::-1], [place(k) for k in range(N)], atol=1e-8)
    np.testing.assert_allclose(found.sigma_m, np.hypot(0.012, 0.014) / np.sqrt(2.0))
    np.testing.assert_allclose(found.sigma_z_m, SIGMA_Z_M)
    assert found.vertical_datum == "ellipsoidal height"
    assert any("NAD83(CSRS)" in note for note in found.notes)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (in_grafnav(height="(ft)"), "metres"),
        (in_grafnav().replace("  0.012   0.014", "  0.012", 1), "values"),
        (in_grafnav().replace("GPSTime", "Epoch  "), "time"),
        (in_grafnav().split("   2312")[0], "positions"),
    ],
)
def test_grafnav_that_cannot_be_used_is_refused(tmp_path: Path, content: str, word: str) -> None:
    (tmp_path / "a.txt").write_text(content)
    code, words = run("localize", tmp_path / "a.txt")
    assert code == 3
    assert word in words


@pytest.mark.parametrize("name", ["a.mp4", "a b.MOV", "a.avi"])
def test_a_video_is_refused_with_the_command_that_takes_its_images(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(bytes(64))
    code, words = run("localize", tmp_path / name)
    assert code == 3
    assert "ffmpeg -i" in words


def test_points_are_no_log(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("1001 5640.25 4210.40 102.3 GRND\n" * 5)
    assert not is_receiver_log(tmp_path / "a.txt")


def test_options_that_do_not_fit_a_log_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.pos").write_text(in_positions())
    (tmp_path / "p.csv").write_text("x_m,y_m,z_m,sigma_z_m\n0,0,1,0.1\n9,0,1,0.1\n0,9,1,0.1\n")
    (tmp_path / "a.jpg").write_bytes(b"JPEG")
    for args, word in {
        ("localize", "a.pos", "--frame-rate", "5"): "--frame-rate",
        ("reconstruct", "a.pos", "--antenna", "1", "--trajectory", "t.csv"): "--trajectory",
        ("reconstruct", "p.csv", "--crs", "EPSG:32632", "--antenna", "1"): "--antenna",
        ("reconstruct", "a.pos", "p.csv", "--antenna", "1"): "apart",
        ("localize", "a.jpg"): "--columns",
    }.items():
        command, *others = [tmp_path / arg if (tmp_path / arg).exists() else arg for arg in args]
        code, words = run(command, *others)
        assert code in (3, 4), words
        assert word in words


def test_heights_of_0_are_no_heights(tmp_path: Path) -> None:
    (tmp_path / "a.gpx").write_text(in_track().replace(f"<ele>{HEIGHT_M}</ele>", "<ele>0</ele>", 7))
    found = read_gps(tmp_path / "a.gpx")
    assert len(found.time_s) == N - 7
    assert any("7 fixes with a height of 0" in note for note in found.notes)
    (tmp_path / "a.gpx").write_text(in_track().replace(f"<ele>{HEIGHT_M}</ele>", "<ele>0</ele>"))
    code, words = run("localize", tmp_path / "a.gpx", "-o", tmp_path / "out", "-q")
    assert code == 0
    assert "all heights are 0" in words
    code, words = run(
        "reconstruct", tmp_path / "a.gpx", "--antenna", "1", "--sigma", "2", "-o", tmp_path / "map"
    )
    assert code == 3
    assert "heights" in words
