"""Colour of rendered images: ratios of red, green and blue to the luminance of every pixel.

The luminance is that of grey images, 0.299 R + 0.587 G + 0.114 B, so that a colour image turned to grey is the grey
image but for the noise. Snow in the sun has the tint of low sunlight and snow in the shade that of the sky; what reflects
less than snow has the tint of stones or of ice; haze and sky are bluish.
"""

import numpy as np

from sim.rendering.compiled import Floats, Ints, entry, f32, row_loop
from sim.rendering.footprint import Footprints
from sim.rendering.visibility import RowRays

# Ratios of red and blue to the luminance.
_SUN = 1.08, 0.84
_SKYLIGHT = 0.89, 1.20
_ROCK = 1.06, 0.86
_ICE = 0.93, 1.10
_WATER = 0.78, 1.12
_HAZE = 0.95, 1.09
_ZENITH = 0.66, 1.52
_HORIZON = 0.92, 1.14
_CLOUD = 0.99, 1.02


@row_loop
def find_bare(n: int, at: Footprints, bare_below: float, haze_m: float) -> None:
    """Leave the shares of bare ground and of clear air as weights; texture darker than -`bare_below` counts as bare."""
    per_haze = f32(1.0 / haze_m)
    for k in range(n):
        at.weight0[k] = min(max(f32(-2.5) * (at.texture[k] + f32(bare_below)), f32(0)), f32(1))
        at.weight1[k] = np.exp(-at.path_m[k] * per_haze)


@row_loop
def tint_ground(n: int, at: Footprints, is_ice: bool, ratios: Floats) -> None:
    """Compute the ratios (2, W) of ground pixels; the weights hold the shares of bare ground and of clear air."""
    zero, one = f32(0), f32(1)
    sun_red, sun_blue, sky_red, sky_blue = f32(_SUN[0]), f32(_SUN[1]), f32(_SKYLIGHT[0]), f32(_SKYLIGHT[1])
    bare_red = f32(_ICE[0]) if is_ice else f32(_ROCK[0])
    bare_blue = f32(_ICE[1]) if is_ice else f32(_ROCK[1])
    for k in range(n):
        c = entry(at.pixel[k])
        direct = at.direct[k] * max(zero, one + at.texture[k])
        sunny = direct / max(direct + at.ambient[k], f32(1e-4))
        red, blue = sky_red + (sun_red - sky_red) * sunny, sky_blue + (sun_blue - sky_blue) * sunny
        bare, wet, clear = at.weight0[k], min(max(at.water[k], zero), one), at.weight1[k]
        red *= (one + bare * (bare_red - one)) * (one + wet * f32(_WATER[0] - 1.0))
        blue *= (one + bare * (bare_blue - one)) * (one + wet * f32(_WATER[1] - 1.0))
        ratios[0, c] = f32(_HAZE[0]) + (red - f32(_HAZE[0])) * clear
        ratios[1, c] = f32(_HAZE[1]) + (blue - f32(_HAZE[1])) * clear


@row_loop
def tint_sky(n: int, sky: Ints, rays: RowRays, opaque: Floats, ratios: Floats) -> None:
    """Compute the ratios (2, W) of the sky's pixels: bluer higher up, white where clouds are opaque."""
    for k in range(n):
        c = entry(sky[k])
        low = np.exp(f32(-3.2) * max(rays.slope[c], f32(0)))
        for channel in range(2):
            high = f32(_ZENITH[channel])
            clear = high + (f32(_HORIZON[channel]) - high) * low
            ratios[channel, c] = clear + (f32(_CLOUD[channel]) - clear) * opaque[k]


def blue_green_red(luminance: Floats, ratios: Floats) -> Floats:
    """Return the radiance of the three channels.

    Parameters
    ----------
    luminance : (H, W) ndarray
        Radiance of the grey image.
    ratios : (H, 2, W) ndarray
        Red and blue over the luminance.

    Returns
    -------
    (H, W, 3) ndarray of float32
        Blue, green, red: their luminance is that of the grey image.

    Examples
    --------
    >>> grey = np.full((1, 1), 0.5, np.float32)
    >>> blue_green_red(grey, np.ones((1, 2, 1), np.float32)).ravel().tolist()
    [0.5, 0.5, 0.5]
    """
    red, blue = luminance * ratios[:, 0], luminance * ratios[:, 1]
    green = (luminance - np.float32(0.299) * red - np.float32(0.114) * blue) / np.float32(0.587)
    return np.stack([blue, green, red], axis=-1)
