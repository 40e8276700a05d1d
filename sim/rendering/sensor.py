"""Image sensor: radiance to 8-bit grey levels with lens blur, vignetting, gain, shot and read noise."""

import cv2
import numpy as np

from sim.config.scene import ImagingConfig
from sim.rendering.compiled import Floats, by_share, f32, hash32, share_out, u32
from survey.core.streams import stream
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Image

_DRAWS = 1 << 21


class ImageSensor:
    """Image sensor; the noise of a frame depends on the seed and its number alone."""

    def __init__(self, config: ImagingConfig, camera: Camera, seed: int) -> None:
        self._config = config
        self._draws = stream(seed, "camera", "noise").standard_normal(_DRAWS, np.float32)
        self._seed = int(stream(seed, "camera", "frames").integers(1 << 30))
        self._transmission = _vignette(camera, config.vignetting)

    def image(self, radiance: Floats, frame_index: int) -> Image:
        """Return the 8-bit image of a frame."""
        config = self._config
        if config.blur_px > 0.0:
            radiance = cv2.GaussianBlur(radiance, (0, 0), config.blur_px)
        gain = config.gain
        if gain is None:
            gain = config.brightness / max(float(np.percentile(radiance[::6, ::6], 90)), 0.1)
        noisy = config.noise == "on"
        image = np.empty(radiance.shape, np.uint8)
        share_out(
            _expose,
            radiance,
            self._transmission,
            gain,
            config.read_noise * noisy,
            config.shot_noise * noisy,
            self._draws,
            self._seed + frame_index,
            image,
        )
        return image


def _vignette(camera: Camera, loss: float) -> Floats:
    """Return the share of light at each pixel, which falls with the square of the distance from the middle."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    squared = (u - camera.matrix[0, 2]) ** 2 + (v - camera.matrix[1, 2]) ** 2
    return (1.0 - loss * squared / squared.max()).astype(np.float32)


@by_share
def _expose(
    worker: int,
    n_workers: int,
    radiance: Floats,
    transmission: Floats,
    gain: float,
    read_sd: float,
    shot_sd: float,
    draws: Floats,
    frame: int,
    image: Image,
) -> None:
    """Compute grey levels: signal plus noise of variance read² + shot² signal, from one window of draws per row."""
    rows, columns = radiance.shape
    gain, read, shot = f32(gain), f32(read_sd * read_sd), f32(shot_sd * shot_sd)
    for row in range(worker, rows, n_workers):
        start = hash32(frame, row) % u32(draws.size - columns)
        for c in range(columns):
            signal = radiance[row, c] * transmission[row, c] * gain
            level = signal + draws[start + c] * np.sqrt(read + shot * max(signal, f32(0)))
            image[row, c] = np.uint8(min(max(level + f32(0.5), f32(0)), f32(255)))
