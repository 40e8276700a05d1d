"""Images of calibration boards by a camera whose lens is given."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from survey.data.camera import Camera
from vision_slam.calibration import CharucoBoard

SIZE = (480, 360)
CAMERA = Camera(
    "pinhole",
    *SIZE,
    np.array([[400.0, 0.0, 246.0], [0.0, 402.0, 175.0], [0.0, 0.0, 1.0]]),
    np.array([-0.12, 0.05, 0.001, -0.0015, 0.0]),
    np.eye(4),
)
_FINER = 2
_TEXTURE_PX = 40  # of a square


def chessboard_texture(columns, rows):
    """Squares of a board with so many inner corners, with a white margin of one square."""
    squares = np.indices((rows + 1, columns + 1)).sum(axis=0) % 2
    board = np.kron(np.where(squares, 255, 0), np.ones((_TEXTURE_PX, _TEXTURE_PX)))
    return np.pad(board, _TEXTURE_PX, constant_values=255.0)


def charuco_texture(board, columns, rows):
    image = board.generateImage((columns * _TEXTURE_PX, rows * _TEXTURE_PX), marginSize=0)
    return np.pad(image.astype(float), _TEXTURE_PX, constant_values=255.0)


class Studio:
    """Renders a flat board for one camera, with 2 × 2 rays a pixel, blur and noise."""

    def __init__(self, camera=CAMERA):
        self.camera = camera
        width, height = camera.width, camera.height
        offsets = (np.arange(_FINER) + 0.5) / _FINER - 0.5
        u = (np.arange(width)[:, None] + offsets).ravel()
        v = (np.arange(height)[:, None] + offsets).ravel()
        self.rays = camera.rays(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))

    def image(self, texture, square_m, pose, rng, noise=2.0, origin_squares=2.0):
        """Image of a texture whose origin lies so many squares from its corner, at a pose (6,) of the board."""
        rotation = Rotation.from_rotvec(pose[:3]).as_matrix()
        normal = rotation[:, 2]
        distance = (normal @ pose[3:]) / (self.rays @ normal)
        xy = ((distance[:, None] * self.rays - pose[3:]) @ rotation)[:, :2] / square_m
        at = ((xy + origin_squares) * _TEXTURE_PX - 0.5).astype(np.float32)
        shape = (self.camera.height * _FINER, self.camera.width * _FINER)
        fine = cv2.remap(
            texture.astype(np.float32),
            at[:, 0].reshape(shape),
            at[:, 1].reshape(shape),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=128.0,
        )
        coarse = cv2.resize(fine, (self.camera.width, self.camera.height), interpolation=cv2.INTER_AREA)
        coarse = (
            cv2.GaussianBlur(coarse, (0, 0), 0.6) * 0.8 + 20.0 + noise * rng.standard_normal(coarse.shape)
        )
        return np.clip(np.round(coarse), 0, 255).astype(np.uint8)


def poses(n, size_m, rng, tilt_deg=35.0, spread=0.28, depth=(0.33, 0.5)):
    """Poses (n, 6) of a board of some size (width, height) [m] whose origin is its first inner corner."""
    found = []
    for k in range(n):
        angle = 2.0 * np.pi * k / n
        tilt = np.radians(rng.uniform(0.4, 1.0) * tilt_deg)
        rotation = Rotation.from_rotvec(tilt * np.array([np.cos(3 * angle), np.sin(3 * angle), 0.0]))
        rotation = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.3, 0.3)]) * rotation
        z = rng.uniform(*depth)
        middle = np.array([spread * z * np.cos(angle), 0.75 * spread * z * np.sin(angle), z])
        half = np.array([0.5 * size_m[0], 0.5 * size_m[1], 0.0])
        found.append(np.r_[rotation.as_rotvec(), middle - rotation.apply(half)])
    return np.array(found)


def chessboard_images(folder, n=14, seed=1, columns=9, rows=6, square_m=0.02, **look):
    """Write n images of a chessboard; return their files."""
    rng = np.random.default_rng(seed)
    studio, texture = Studio(), chessboard_texture(columns, rows)
    folder.mkdir(exist_ok=True)
    files = []
    for k, pose in enumerate(poses(n, ((columns - 1) * square_m, (rows - 1) * square_m), rng, **look)):
        files.append(folder / f"IMG_{k:04d}.png")
        cv2.imwrite(str(files[-1]), studio.image(texture, square_m, pose, rng))
    return files


def charuco_images(folder, n=10, seed=5):
    """Write n images of a ChArUco board of 8 by 6 squares of 22 mm with markers of 16 mm; return its description."""
    board, rng, studio = CharucoBoard(8, 6, 0.022, 0.016, "4X4_50"), np.random.default_rng(seed), Studio()
    texture = charuco_texture(board.board, 8, 6)
    folder.mkdir(exist_ok=True)
    for k, pose in enumerate(poses(n, (8 * 0.022, 6 * 0.022), rng, spread=0.3)):
        image = studio.image(texture, 0.022, pose, rng, origin_squares=1.0)
        cv2.imwrite(str(folder / f"{k}.png"), image)
    return board
