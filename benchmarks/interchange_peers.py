"""Reads an exported drive or world as its users do: ``PYTHON interchange_peers.py {euroc,kitti,mesh} PATH``.

Run by the Python that has pyorbslam3, pykitti or trimesh. Prints a JSON object of what was read. EuRoC's layout is read by
its own rules (https://projects.asl.ethz.ch/datasets, kmavvisualinertialdatasets) and given to ORB-SLAM3; ``vocabulary.txt``
beside the folder is its vocabulary.
"""

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np


def euroc(place):
    """Give every image to ORB-SLAM3; return how many it got, and how many inertial readings and real poses stand in the tables."""
    import cv2
    import pyorbslam3
    from peers_in_vision.peer_script import SETTINGS

    mav = place / "mav0"
    text = (mav / "cam0" / "sensor.yaml").read_text()
    numbers = {key: json.loads(re.search(rf"^{key}: (\[.*\])$", text, re.MULTILINE)[1]) for key in (
        "intrinsics", "distortion_coefficients", "resolution",
    )}  # fmt: skip
    is_fisheye = "distortion_model: equidistant" in text
    names = ("k1", "k2", "k3", "k4") if is_fisheye else ("k1", "k2", "p1", "p2")
    lens = zip(names, numbers["distortion_coefficients"], strict=True)
    settings = SETTINGS.format(
        **dict(zip(("fx", "fy", "cx", "cy"), numbers["intrinsics"], strict=True)),
        **dict(zip(("width", "height"), numbers["resolution"], strict=True)),
        orbslam3_model="KannalaBrandt8" if is_fisheye else "PinHole",
        orbslam3_lens="\n".join(f"Camera1.{name}: {value}" for name, value in lens),
        fps=round(float(re.search(r"^rate_hz: (.*)$", text, re.MULTILINE)[1])),
    )
    (place.parent / "settings.yaml").write_text(settings)
    slam = pyorbslam3.Slam(
        str(place.parent / "vocabulary.txt"), str(place.parent / "settings.yaml"), pyorbslam3.Sensor.MONOCULAR
    )
    n_images = 0
    for stamp_ns, name in rows(mav / "cam0" / "data.csv"):
        image = cv2.imread(str(mav / "cam0" / "data" / name), cv2.IMREAD_GRAYSCALE)
        slam.track_monocular(image, 1.0 + 1e-9 * float(stamp_ns))
        n_images += 1
    slam.shutdown()
    tables = {"inertial": "imu0", "real poses": "state_groundtruth_estimate0"}
    return {"images": n_images} | {key: len(rows(mav / name / "data.csv")) for key, name in tables.items()}


def rows(file):
    """Return the rows of a table of EuRoC."""
    with file.open() as stream:
        return [row for row in csv.reader(stream) if not row[0].startswith("#")]


def kitti(place):
    """Read a sequence ``sequences/00`` by pykitti."""
    import pykitti

    drive = pykitti.odometry(str(place), "00")
    images = [np.array(image) for image in drive.cam0]
    counts = {"images": len(images), "times": len(drive.timestamps), "real poses": len(drive.poses)}
    return counts | {"scans": sum(len(scan) > 0 for scan in drive.velo)}


def mesh(file):
    """Read a mesh by trimesh; a texture of one pixel is its stand-in for none."""
    import trimesh

    scene = trimesh.load_scene(file)
    (ground,) = scene.geometry.values()
    visual = ground.visual.material
    image = getattr(visual, "baseColorTexture", None) or getattr(visual, "image", None)
    height = np.ptp(ground.bounds, axis=0)
    return {
        "vertices": len(ground.vertices),
        "faces": len(ground.faces),
        "texels": image.size[0],
        "span": height.tolist(),
    }


if __name__ == "__main__":
    kind, place = sys.argv[1:]
    print(json.dumps({"euroc": euroc, "kitti": kitti, "mesh": mesh}[kind](Path(place))))
