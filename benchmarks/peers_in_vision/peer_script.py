"""Runs ORB-SLAM3 or COLMAP over a folder of images: ``PYTHON peer_script.py {orbslam3,colmap} FOLDER OUT``.

Run by the Python that has them, which needs NumPy alone beside them. FOLDER holds ``images/``, ``frames.npy``,
``drive.json`` with times and calibration, and ``vocabulary.txt``. OUT gets the indices of the images with a pose, camera
to world as 4 × 4 matrices, and the CPU seconds of all threads.
"""

import importlib
import json
import sys
import threading
import time
from pathlib import Path

import numpy as np

# The settings that ORB-SLAM3 ships for KITTI, monocular.
SETTINGS = """%YAML:1.0
File.version: "1.0"
Camera.type: "{orbslam3_model}"
Camera1.fx: {fx}
Camera1.fy: {fy}
Camera1.cx: {cx}
Camera1.cy: {cy}
{orbslam3_lens}
Camera.width: {width}
Camera.height: {height}
Camera.newWidth: {width}
Camera.newHeight: {height}
Camera.fps: {fps}
Camera.RGB: 1
ORBextractor.nFeatures: 2000
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
Viewer.KeyFrameSize: 0.1
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 1.0
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.15
Viewer.CameraLineWidth: 2.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -10.0
Viewer.ViewpointZ: -0.1
Viewer.ViewpointF: 2000.0
"""
MAX_FEATURES = 2000  # of an image; with COLMAP's 8192 the matching of a pair takes 16 times as long


def orbslam3(folder, drive):
    """Give the images as in real time on a machine of its own, however busy this one is; return the saved path."""
    peer = importlib.import_module("pyorbslam3")
    times, frames = np.array(drive["time_s"]), np.load(folder / "frames.npy", mmap_mode="r")
    times = times - times[0] + 1.0
    settings, saved = folder / "settings.yaml", folder / "saved.txt"
    lens = "\n".join(f"Camera1.{name}: {value}" for name, value in drive["distortion"].items())
    model = "KannalaBrandt8" if drive["is_fisheye"] else "PinHole"
    settings.write_text(SETTINGS.format(**drive, orbslam3_model=model, orbslam3_lens=lens))
    slam = peer.Slam(str(folder / "vocabulary.txt"), str(settings), peer.Sensor.MONOCULAR)
    began_cpu_s, waited_s = time.process_time(), 0.0
    for time_s, step_s, frame in zip(times, np.diff(times, append=times[-1]), frames, strict=True):
        before = looked_at()
        slam.track_monocular(np.array(frame), time_s)
        waited_s += wait_as_in_real_time(before, step_s)
    slam.shutdown()
    cpu_s = time.process_time() - began_cpu_s - waited_s
    slam.save_trajectory_euroc(str(saved))
    rows = np.loadtxt(saved, ndmin=2)
    index = np.abs(times[:, None] - 1e-9 * rows[:, 0]).argmin(axis=0)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = [matrix(q) for q in rows[:, 4:8]], rows[:, 1:4]
    return index, poses, cpu_s


def wait_as_in_real_time(before, step_s):
    """Wait until another thread has run for the time to the next image, or all are idle; return the CPU time of looking [s].

    Idle threads wake for microseconds every few milliseconds.
    """
    began_s, looks = time.thread_time(), [looked_at()]
    while ran_ns(before, looks[-1]) < 1e9 * step_s:
        time.sleep(0.008)
        looks = [*looks[-3:], looked_at()]
        waits = any(all(thread in look and look[thread][1] for look in looks) for thread in looks[-1])
        if len(looks) == 4 and ran_ns(looks[0], looks[-1]) < 1_000_000 and not waits:
            break
    return time.thread_time() - began_s


def ran_ns(before, now):
    """Return the longest time that a thread has run between two looks [ns]."""
    return max((ran - before.get(thread, (0,))[0] for thread, (ran, _) in now.items()), default=0)


def looked_at():
    """Return the time that each other thread has run [ns], and whether it runs or waits for a processor."""
    found = {}
    for folder in Path("/proc/self/task").iterdir():
        if folder.name != str(threading.get_native_id()):
            try:
                ran_ns = int((folder / "schedstat").read_text().split()[0])
                found[folder.name] = ran_ns, ") R " in (folder / "stat").read_text()
            except (FileNotFoundError, ProcessLookupError):  # the thread has ended
                continue
    return found


def matrix(quaternion):
    """Return the rotation matrix of a quaternion x, y, z, w."""
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * skew + 2.0 * skew @ skew


def colmap(folder, drive):
    """Extract, match each image with its ten neighbours and with farther ones, and map; the lens is refined."""
    peer = importlib.import_module("pycolmap")
    database, images = folder / "colmap.db", folder / "images"
    lens = [*(drive[name] for name in ("fx", "fy", "cx", "cy")), *drive["distortion"].values()]
    model = "OPENCV_FISHEYE" if drive["is_fisheye"] else "OPENCV"
    reader = peer.ImageReaderOptions(camera_model=model, camera_params=",".join(map(str, lens)))
    extraction, mapping = peer.FeatureExtractionOptions(), peer.IncrementalPipelineOptions()
    matching, verification = peer.FeatureMatchingOptions(), peer.TwoViewGeometryOptions()
    extraction.sift.max_num_features = MAX_FEATURES
    extraction.num_threads = matching.num_threads = mapping.num_threads = 1
    # Cameras that look ahead: with its 16 degrees and less forward motion no first pair is found.
    mapping.mapper.init_min_tri_angle, mapping.mapper.init_max_forward_motion = 4.0, 1.0
    mapping.random_seed = verification.ransac.random_seed = 0
    began_cpu_s = time.process_time()
    peer.extract_features(
        database,
        images,
        camera_mode=peer.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=extraction,
    )
    peer.match_sequential(database, matching_options=matching, verification_options=verification)
    (folder / "model").mkdir()
    maps = peer.incremental_mapping(database, images, folder / "model", options=mapping)
    cpu_s = time.process_time() - began_cpu_s
    largest = max(maps.values(), key=lambda one: one.num_reg_images())
    placed = sorted((image for image in largest.images.values() if image.has_pose), key=lambda one: one.name)
    poses = np.tile(np.eye(4), (len(placed), 1, 1))
    poses[:, :3] = [image.cam_from_world().inverse().matrix() for image in placed]
    return np.array([int(Path(image.name).stem) for image in placed]), poses, cpu_s


if __name__ == "__main__":
    program, place, out = sys.argv[1:]
    given = json.loads((Path(place) / "drive.json").read_text())
    found = {"orbslam3": orbslam3, "colmap": colmap}[program](Path(place), given)
    np.savez(out, **dict(zip(("index", "poses", "cpu_s"), found, strict=True)))
