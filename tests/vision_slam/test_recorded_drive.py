"""Settings of a recorded drive."""

import numpy as np
import pytest

from survey.core.errors import ConfigError
from vision_slam.config import LocalizationConfig
from vision_slam.recorded_drive import RecordedDrive


def test_settings_of_vision_are_reached_beside_those_of_localization() -> None:
    drive = RecordedDrive(None)  # type: ignore[arg-type]  # the settings do not depend on the records
    settings = ["visual.pixel_sigma=1.5", "localization.gps_bias_sigma_m=3.0", "visual.lens=refine"]
    assert drive.visual_config(settings).pixel_sigma == 1.5
    assert drive.visual_config(settings).lens == "refine"
    assert drive.config(settings).gps_bias_sigma_m == 3.0


def test_an_unknown_section_is_refused_with_those_that_exist() -> None:
    with pytest.raises(ConfigError, match=r"visual\.KEY=VALUE"):
        RecordedDrive(None).visual_config(["planner.swaths=3"])  # type: ignore[arg-type]


def test_a_lens_of_unknown_distortion_widens_the_error_of_scale_for_longer() -> None:
    usual, widened = LocalizationConfig().with_image_errors(), LocalizationConfig().with_image_errors(0.25)
    assert widened.scale_wander_sigma == pytest.approx(np.hypot(usual.scale_wander_sigma, 0.25))
    assert widened.scale_wander_m > usual.scale_wander_m
