"""Photographs far apart, placed by shared features: ``python -m benchmarks.photographs``.

Flights over drawn ground are traced exactly; nothing was chosen on their seeds. Their lens is the stated one, or another one
that no header states (4 % of the focal length, k1 of -0.08); their fixes err as the settings assume, or with heavy tails
(Student's t with 2 degrees). Streets are every fifth image of the recorded drives (FIRNLINE_DATA), 2 to 6 m apart, with
white fixes of 3 m at every other photograph; errors are those at the photographs whose fixes were withheld. COLMAP
(``pycolmap`` of the extra ``peers``, in the Python that ``FIRNLINE_PEERS`` names) gets the same streets.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from benchmarks.peers_in_vision import peer_script
from benchmarks.real_drives.drives import Images, drive_folders, opened
from benchmarks.report import Row, cpu_seconds, main
from survey import Camera, Recording
from survey.core.arrays import FloatArray, IntArray
from survey.core.streams import stream
from survey.data.frames import Frames
from survey.data.sensors.records import GpsFixes
from tests.vision_slam.photographed_ground import LENS, flight, height_m, photograph, texture, with_distortion
from vision_slam.config import LocalizationConfig
from vision_slam.drive_estimate import Localization
from vision_slam.photographs.georeference import georeferenced
from vision_slam.photographs.matches import tracks_of
from vision_slam.photographs.structure import PlacedCameras, reconstruct_cameras

_CRS, _ORIGIN = "EPSG:32608", np.array([5e5, 6.7e6, 300.0])
_SEEDS, _N_RECEIVERS = (31, 32, 33), 8
_EVERY, _FIX_M, _UPWARD = 5, 3.0, 1.7
_OTHER_LENS = with_distortion(LENS, -0.08, 1.04)
_BETWEEN_S = 4.0  # photographs of a flight


class _Flight(NamedTuple):
    """A kind of flight: how far its camera looks down [deg], its lens, and whether its fixes have heavy tails."""

    name: str
    down_deg: float
    lens: Camera
    has_heavy_tails: bool = False


_FLIGHTS = (
    _Flight("from above, lens stated", 85.0, LENS),
    _Flight("from above, another lens, not stated", 85.0, _OTHER_LENS),
    _Flight("ahead and down, another lens, not stated", 50.0, _OTHER_LENS),
    _Flight("from above, another lens, fixes with heavy tails", 85.0, _OTHER_LENS, has_heavy_tails=True),
)


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of flights and of streets."""
    for kind in _FLIGHTS[:1] if quick else _FLIGHTS:
        yield from _flown(kind, _SEEDS[:1] if quick else _SEEDS)
    folders = drive_folders()
    if not folders:
        sys.exit("the recorded drives are not here; set FIRNLINE_DATA.")
    for name, folder in list(folders.items())[-1:] if quick else folders.items():
        yield from _street(name, folder)


class _Judged(NamedTuple):
    """Errors of one localization: of places (K, 3), of the mean of its fixes (3,), NEES (K,), and which ground lies within 95 % (J,)."""

    off_m: FloatArray
    nees: FloatArray
    is_covered: FloatArray


def _flown(kind: _Flight, seeds: Sequence[int]) -> Iterator[Row]:
    """Yield shape, errors and honesty of flights of one kind."""
    shapes, shares, judged, fixes_off = [], [], list[_Judged](), []
    for seed in seeds:
        poses = flight(seed, 3, 6, 9.0, 28.0, kind.down_deg)
        ground = texture(seed)
        frames = Frames(
            _BETWEEN_S * np.arange(len(poses)), Images([photograph(one, kind.lens, ground) for one in poses])
        )
        given = LENS if kind.lens is LENS else replace(LENS, distortion_is_assumed=True)
        structure = reconstruct_cameras(tracks_of(frames), given)
        shares.append(0.0 if structure is None else len(structure.image) / len(poses))
        if structure is None:
            continue
        shapes.append(_shape_error(structure.poses[:, :3, 3], poses[structure.image, :3, 3]))
        for k in range(_N_RECEIVERS):
            off = _receiver(seed, k, len(poses), heavy=kind.has_heavy_tails)
            fixes_off.append(np.linalg.norm(off, axis=1))
            found = georeferenced(structure, _recording(frames, given, poses, off), LocalizationConfig())
            judged.append(_judge(found, poses[structure.image]))
    yield Row.of(f"{kind.name}: photographs placed, least", 100.0 * min(shares), "%", ">=", 95.0)
    yield Row(f"{kind.name}: Sim(3) error of the cameras, worst", 100.0 * max(shapes), "cm")
    rms = [float(np.sqrt((one.off_m**2).sum(axis=1).mean())) for one in judged]
    raw = [float(np.sqrt((off**2).mean())) for off in fixes_off]
    ratio = np.array(rms) / np.array(raw)
    yield Row.of(f"{kind.name}: RMS error over that of the fixes, mean", float(ratio.mean()), "x", "<=", 1.0)
    yield Row(f"{kind.name}: RMS error over that of the fixes, worst", float(ratio.max()), "x")
    nees = float(np.mean([one.nees.mean() for one in judged]))
    yield Row(
        f"{kind.name}: NEES of places, 1 for true covariances", nees, "", "0.5 to 4", 0.5 <= nees <= 4.0
    )
    covered = [100.0 * float(one.is_covered.mean()) for one in judged]
    yield Row(f"{kind.name}: ground within 95 %, mean", float(np.mean(covered)), "%")


def _receiver(seed: int, k: int, n: int, *, heavy: bool) -> FloatArray:
    """Return errors of fixes (N, 3) [m]: a level that lasts and one of each, as assumed or with heavy tails."""
    draw, axes = stream(seed, "photographs", f"receiver {k}"), np.array([1.0, 1.0, _UPWARD])
    own = 0.5 * (draw.standard_t(2.0, (n, 3)) if heavy else draw.standard_normal((n, 3)))
    return axes * (draw.standard_normal(3) + own)


def _recording(frames: Frames, camera: Camera, poses: FloatArray, off_m: FloatArray) -> Recording:
    """Return photographs whose fixes are off."""
    place = _ORIGIN + poses[:, :3, 3] + off_m
    gps = GpsFixes(frames.time_s, place)
    return Recording(_CRS, place[0], gps, camera=camera, frames=frames, start_is_surveyed=False)


def _judge(found: Localization, poses: FloatArray) -> _Judged:
    """Compare path and landmarks with the truth."""
    off = found.trajectory.position - _ORIGIN - poses[:, :3, 3]
    nees = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.trajectory.covariance), off) / 3.0
    x, y, z = (found.points.xyz - _ORIGIN).T
    covered = np.abs(z - height_m(x, y)) < 1.96 * found.points.sigma_z
    return _Judged(off, nees, covered.astype(np.float64))


def _shape_error(estimate: FloatArray, real: FloatArray) -> float:
    """Return the RMS distance of places (K, 3) from the real ones after the best similarity (Umeyama 1991)."""
    a, b = estimate - estimate.mean(axis=0), real - real.mean(axis=0)
    u, size, v = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    scale = (size * sign).sum() / max(float((a**2).sum()), 1e-12)
    return float(np.sqrt(((scale * a @ (u * sign @ v).T - b) ** 2).sum(axis=1).mean()))


def _street(name: str, folder: Path) -> Iterator[Row]:
    """Yield how a street is placed, beside COLMAP, and the errors where fixes were withheld."""
    sequence = opened(folder)
    assert sequence.reference is not None
    chosen = np.arange(0, len(sequence.frames), _EVERY)
    frames = Frames(sequence.frames.time_s[chosen], Images([sequence.frames[k] for k in chosen.tolist()]))
    cameras = (sequence.reference @ sequence.camera.T_body_camera)[chosen]
    title = f"street {name}, {len(chosen)} photographs"
    structure, cpu_s = cpu_seconds(lambda: reconstruct_cameras(tracks_of(frames), sequence.camera))
    if structure is None:
        yield Row.of(f"{title}: placed", 0.0, "%", ">=", 95.0)
        return
    yield Row.of(f"{title}: placed", 100.0 * len(structure.image) / len(chosen), "%", ">=", 95.0)
    yield Row(
        f"{title}: Sim(3) error",
        _shape_error(structure.poses[:, :3, 3], cameras[structure.image, :3, 3]),
        "m",
    )
    yield Row(f"{title}: features, matches and cameras", cpu_s, "CPU-s")
    peer = _colmap(frames, sequence.camera)
    if peer is not None:
        index, poses, peer_s = peer
        yield Row(f"{title}: placed by COLMAP", 100.0 * len(index) / len(chosen), "%")
        yield Row(
            f"{title}: Sim(3) error of COLMAP", _shape_error(poses[:, :3, 3], cameras[index, :3, 3]), "m"
        )
        yield Row(f"{title}: COLMAP", peer_s, "CPU-s")
    yield from _withheld(title, structure, frames, sequence.camera, cameras)


def _withheld(
    title: str, structure: PlacedCameras, frames: Frames, camera: Camera, cameras: FloatArray
) -> Iterator[Row]:
    """Yield the errors at every other photograph, of which no fix is given."""
    is_given = np.arange(len(frames)) % 2 == 0
    mount = camera.T_body_camera
    bodies = cameras @ np.linalg.inv(mount)
    rms, nees = [], []
    for seed in _SEEDS:
        off = (
            _FIX_M * np.array([1.0, 1.0, _UPWARD]) * stream(seed, "streets").standard_normal((len(frames), 3))
        )
        place = _ORIGIN + bodies[:, :3, 3] + off
        stated = np.full(int(is_given.sum()), _FIX_M)
        gps = GpsFixes(frames.time_s[is_given], place[is_given], sigma_m=stated, sigma_z_m=_UPWARD * stated)
        # Fixes count for photographs within two seconds: the times of the withheld ones are moved away.
        apart = replace(frames, time_s=20.0 * np.arange(len(frames)))
        gps = replace(gps, time_s=apart.time_s[is_given])
        recording = Recording(_CRS, place[0], gps, camera=camera, frames=apart, start_is_surveyed=False)
        found = georeferenced(structure, recording, LocalizationConfig()).trajectory
        error = found.position - _ORIGIN - bodies[structure.image, :3, 3]
        held = ~is_given[structure.image]
        rms.append(float(np.sqrt((error[held, :2] ** 2).sum(axis=1).mean())))
        nees.append(
            float(np.mean(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error)) / 3.0)
        )
    yield Row.of(
        f"{title}: RMS error on the map without a fix, worst of {len(rms)}", max(rms), "m", "<=", 3.0
    )
    yield Row(f"{title}: NEES with fixes of 3 m, mean", float(np.mean(nees)), "", "", None)


def _colmap(frames: Frames, camera: Camera) -> tuple[IntArray, FloatArray, float] | None:
    """Run COLMAP; return images, poses and CPU seconds, and none where it is not named or fails."""
    python = os.environ.get("FIRNLINE_PEERS")
    if python is None:
        return None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "images").mkdir()
        for k in range(len(frames)):
            cv2.imwrite(str(folder / "images" / f"{k:06d}.png"), frames[k])
        k1, k2, p1, p2 = camera.distortion[:4].tolist()
        facts = {
            **{"fx": camera.matrix[0, 0], "fy": camera.matrix[1, 1], "cx": camera.matrix[0, 2]},
            **{
                "cy": camera.matrix[1, 2],
                "is_fisheye": False,
                "distortion": {"k1": k1, "k2": k2, "p1": p1, "p2": p2},
            },
        }
        (folder / "drive.json").write_text(json.dumps(facts), encoding="utf-8")
        command = [python, str(peer_script.__file__), "colmap", place, str(folder / "found.npz")]
        if subprocess.run(command, check=False, capture_output=True).returncode:
            return None
        with np.load(folder / "found.npz") as found:
            return found["index"], found["poses"], float(found["cpu_s"])


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main("Photographs far apart", measure, ("numpy", "opencv-python-headless"))
