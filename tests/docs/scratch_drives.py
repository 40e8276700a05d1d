"""Small recordings for the console transcripts: 21 m to the north over speckled ground, seen 96 times.

| name | content |
|---|---|
| my-images, phone.nmea | images with times and camera.toml; a fix every second |
| video-frames, fixes.csv | the same images without times, 4 a second; fixes with German names of columns |
| phone-photos | the same as JPEG, with times, focal length and positions in EXIF |
| drone-photos | ten photographs from a drone, with the same in EXIF |
| KITTI_sequence_1 | the same in KITTI's layout, with poses |
| drive.bag | the same with the fixes as a ROS 1 bag |
| board-photos, charuco-photos | images of two calibration boards |
"""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Picture
from pyproj import Transformer

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from survey.data.frames import Image
from tests.vision_slam import rendered
from tests.vision_slam.conftest import PlaneWorld, mounted
from tests.vision_slam.photographed_ground import LENS, flight, photograph, texture, with_distortion
from tests.vision_slam.readers.test_bags import first_bag
from tests.vision_slam.readers.test_photo_folder import exif_of, position

N_IMAGES, STEP_M, RATE_HZ = 96, 0.22, 4.0
LATITUDE, LONGITUDE, HEIGHT_M = 60.43, -135.0, 800.0
DEG_PER_M = 1.0 / 111_412.0
START_S = 1_781_258_400  # 2026-06-12 10:00:00 UTC
CAMERA = Camera(
    "pinhole",
    320,
    240,
    np.array([[240.0, 0, 159.5], [0, 240.0, 119.5], [0, 0, 1]]),
    np.full(5, 1e-9),
    mounted(),
)
EVERY = 4  # images between two fixes


def latitudes() -> FloatArray:
    """Return the latitude of each image."""
    noise = np.random.default_rng(2).normal(0.0, 0.2, N_IMAGES)
    return np.asarray(LATITUDE + DEG_PER_M * (STEP_M * np.arange(N_IMAGES) + noise))


@cache
def images() -> tuple[Image, ...]:
    """Draw what the camera sees."""
    world, pose = PlaneWorld(CAMERA), np.eye(4)
    drawn = []
    for k in range(N_IMAGES):
        pose[0, 3] = STEP_M * k
        drawn.append(world.image(pose))
    return tuple(drawn)


def make_drives(folder: Path, commands: str) -> None:
    """Write the recordings that some commands name into an existing folder; they are the same each time."""
    for name, write in WRITERS.items():
        if name in commands:
            write(folder)
    CAMERA.write(folder / "camera.toml")


def _pictures(folder: Path, name: str) -> None:
    folder.mkdir(parents=True)
    for k, image in enumerate(images(), 1):
        cv2.imwrite(str(folder / name.format(k)), image)


def _write_images(folder: Path) -> None:
    """Write images, times, calibration, and the fixes beside them."""
    drive = folder / "my-images"
    _pictures(drive / "images", "{:04d}.png")
    times = START_S + np.arange(N_IMAGES) / RATE_HZ
    (drive / "times.txt").write_text("".join(f"{t:.2f}\n" for t in times), encoding="utf-8")
    CAMERA.write(drive / "camera.toml")
    sentences = [_sentence("GPRMC,100000.00,A,,,,,0.0,0.0,120626,,")]
    for k, latitude in enumerate(latitudes()[::EVERY]):
        north, west = _minutes(latitude), _minutes(-LONGITUDE)
        sentences.append(
            _sentence(f"GPGGA,1000{k:02d}.00,{north:010.5f},N,{west:011.5f},W,1,08,0.9,{HEIGHT_M},M,0,M,,")
        )
    (folder / "phone.nmea").write_text("\n".join(sentences), encoding="utf-8")


def _sentence(text: str) -> str:
    """Add the checksum of NMEA 0183."""
    check = 0
    for letter in text:
        check ^= ord(letter)
    return f"${text}*{check:02X}"


def _minutes(angle_deg: float) -> float:
    whole = int(angle_deg)
    return 100.0 * whole + 60.0 * (angle_deg - whole)


def _write_video(folder: Path) -> None:
    _pictures(folder / "video-frames", "frame{:06d}.png")
    CAMERA.write(folder / "video-frames" / "camera.toml")
    rows = [f"{k}.0,{b:.8f},{LONGITUDE},{HEIGHT_M}\n" for k, b in enumerate(latitudes()[::EVERY])]
    (folder / "fixes.csv").write_text("t,phi,lambda,height\n" + "".join(rows), encoding="utf-8")


def _write_photos(folder: Path) -> None:
    (folder / "phone-photos").mkdir()
    for k, (image, latitude) in enumerate(zip(images(), latitudes(), strict=True)):
        second, quarter = divmod(k, int(RATE_HZ))
        header = exif_of(
            second, subseconds=f"{25 * quarter:02d}", gps=position(latitude, LONGITUDE, HEIGHT_M, 1.0)
        )
        Picture.fromarray(image).save(folder / "phone-photos" / f"IMG_{k:04d}.jpg", exif=header, quality=95)


def _write_drone_photos(folder: Path) -> None:
    """Write photographs from a drone, four seconds and nine metres apart, with times, focal length and positions in EXIF."""
    (folder / "drone-photos").mkdir()
    ground, lens = texture(1), with_distortion(LENS, -0.05)
    to_degrees = Transformer.from_crs("EPSG:32608", "EPSG:4326", always_xy=True)
    for k, pose in enumerate(flight(2, 2, 5, 9.0, 26.0, 80.0)):
        east, north, up = pose[:3, 3] + [5e5, 6.7e6, HEIGHT_M]
        longitude, latitude = to_degrees.transform(east, north)
        header = exif_of(4 * k, gps=position(latitude, longitude, up, 1.0))
        header.get_ifd(0x8769)[41989] = 32  # 320 pixels of 360 columns on film of 36 mm
        picture = Picture.fromarray(photograph(pose, lens, ground))
        picture.save(folder / "drone-photos" / f"DJI_{k + 1:04d}.JPG", exif=header, quality=95)


def _write_kitti(folder: Path) -> None:
    folder = folder / "KITTI_sequence_1"
    _pictures(folder / "image_0", "{:06d}.png")
    (folder / "calib.txt").write_text("P0: 240 0 159.5 0 0 240 119.5 0 0 0 1 0", encoding="utf-8")
    down, ahead = np.sin(np.radians(25.0)), np.cos(np.radians(25.0))
    rows = [
        f"1 0 0 0 0 1 0 {-STEP_M * k * down:.6f} 0 0 1 {STEP_M * k * ahead:.6f}\n" for k in range(N_IMAGES)
    ]
    (folder / "poses.txt").write_text("".join(rows), encoding="utf-8")


def _write_bag(folder: Path) -> None:
    with first_bag(folder / "drive.bag") as bag:
        bag.calibration("/camera/camera_info")
        for k, (image, latitude) in enumerate(zip(images(), latitudes(), strict=True)):
            second = START_S + k / RATE_HZ
            bag.image("/camera/image_raw", second, image, "mono8")
            if k % EVERY == 0:
                bag.fix(second, latitude, 0)


WRITERS = {
    "my-images": _write_images,
    "video-frames": _write_video,
    "phone-photos": _write_photos,
    "drone-photos": _write_drone_photos,
    "KITTI_sequence_1": _write_kitti,
    "drive.bag": _write_bag,
    "board-photos": lambda folder: rendered.chessboard_images(folder / "board-photos"),
    "charuco-photos": lambda folder: rendered.charuco_images(folder / "charuco-photos"),
}
