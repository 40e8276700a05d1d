"""Configuration of the simulated scene: fine relief and hazards, light and surface, lens and image sensor."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from survey.core.config import Section, Share

LARGEST_STEP_M = 0.25
"""Widest distance between the nodes of fine ground that rover and camera can be simulated on [m]."""


class SceneryConfig(Section):
    """Relief finer than the terrain's cells, and what a rover had better avoid; counts are per hectare."""

    step_m: Annotated[float, Field(gt=0.0, le=LARGEST_STEP_M)] = 0.25
    """Widest distance between the nodes of the fine terrain [m]."""
    wind_from_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 235.0
    """Where the wind comes from that shaped the snow, clockwise from north [deg]."""
    dune_sd_m: NonNegativeFloat = 0.10
    """Standard deviation of snow dunes, 3 to 25 m long [m]."""
    sastrugi_sd_m: NonNegativeFloat = 0.03
    """Standard deviation of sastrugi, 1 to 4 m long [m]."""
    hummock_sd_m: NonNegativeFloat = 0.04
    """Standard deviation of ice hummocks, 2 to 12 m wide, without direction [m]."""
    crevasses_per_ha: NonNegativeFloat = 0.15
    """Crevasses, open and bridged."""
    bridged_share: Share = 0.4
    """Share of the crevasses that snow has bridged."""
    crevasse_depth_m: PositiveFloat = 4.5
    """Depth of open crevasses [m]."""
    pools_per_ha: NonNegativeFloat = 0.35
    """Melt pools."""
    channels_per_ha: NonNegativeFloat = 0.12
    """Melt channels."""
    dirt_cones_per_ha: NonNegativeFloat = 1.0
    """Dirt cones, 0.3 to 1 m high."""


class AppearanceConfig(Section):
    """Sun, air and the look of the surface."""

    sun_elevation_deg: Annotated[float, Field(gt=2.0, le=90.0)] = 25.0
    """Height of the sun above the horizon [deg]."""
    sun_from_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 220.0
    """Direction of the sun, clockwise from north [deg]."""
    sky_share: Share = 0.45
    """Share of the light on flat ground that comes from the sky; 1 is overcast."""
    haze_m: PositiveFloat = 3000.0
    """Distance at which haze leaves 1/e of the contrast [m]."""
    contrast: NonNegativeFloat = 1.0
    """Factor on the surface's fine texture; 1 is strongly wind-worked snow (3 to 4 % local contrast)."""
    debris: NonNegativeFloat = 1.0
    """Dark specks and stones, 6 per square metre at 1."""
    patches: NonNegativeFloat = 1.0
    """Strength of the grey patches of old snow, 4 to 120 m wide."""
    stones: Share = 0.0
    """Share of the ice that stones cover: 0 is snow, 1 a debris-covered tongue."""
    ridges_deg: NonNegativeFloat = 5.0
    """Mean height of the mountains around above the horizon; 0 hides them [deg]."""
    ridges_distance_m: PositiveFloat = 8000.0
    """Distance of those mountains [m]."""


class ImagingConfig(Section):
    """The rover's camera: a wide-angle fisheye that looks ahead and down, and its sensor."""

    width: PositiveInt = 640
    """Columns [pixels]."""
    height: PositiveInt = 480
    """Rows [pixels]."""
    field_of_view_deg: Annotated[float, Field(gt=10.0, lt=175.0)] = 100.0
    """Angle across the image's width [deg]."""
    distortion: tuple[float, float, float, float] = (-0.02, 0.004, 0.0, 0.0)
    """k1 to k4 of OpenCV's fisheye model."""
    height_m: PositiveFloat = 0.7
    """Height above the ground between the tracks [m]."""
    forward_m: float = 0.2
    """Distance ahead of the body's origin [m]."""
    pitch_down_deg: Annotated[float, Field(ge=-45.0, le=80.0)] = 15.0
    """Angle of the optical axis below the body's x axis [deg]."""
    row_readout_s: NonNegativeFloat = 0.0
    """Rolling shutter: time between neighbouring rows [s]."""
    exposure_s: NonNegativeFloat = 0.0
    """Time during which motion blurs a frame; 0 for none [s]."""
    gain: PositiveFloat | None = None
    """Grey levels per unit of radiance; automatic when not given."""
    brightness: Annotated[float, Field(gt=0.0, le=250.0)] = 200.0
    """Grey level that automatic gain gives to the 90th percentile."""
    vignetting: Share = 0.15
    """Loss of light in the corners."""
    blur_px: NonNegativeFloat = 0.5
    """Standard deviation of the lens's blur [pixels]."""
    noise: Literal["on", "off"] = "on"
    """Whether the sensor adds shot and read noise."""
    read_noise: NonNegativeFloat = 0.6
    """Standard deviation of the read noise [grey levels]."""
    shot_noise: NonNegativeFloat = 0.085
    """Standard deviation of the shot noise per square root of a grey level."""
