"""Tie lines: a few lines across the swaths, which show errors that drift along swaths."""

import numpy as np

from planners.config import SwathConfig
from planners.config_lawnmower import LawnmowerConfig
from planners.swaths.swaths import Swath, reference_lines
from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea


def tie_lines(area: SurveyArea, config: SwathConfig, heading_deg: float, after: FloatArray) -> list[Swath]:
    """Lay `config.tie_lines` straight lines square to the swaths, evenly over the area.

    Parameters
    ----------
    area : SurveyArea
        What is surveyed.
    config : SwathConfig
        Number of lines.
    heading_deg : float
        Heading of the swaths.
    after : (2,) ndarray
        Where the last swath ends [m]; the lines begin at the nearest corner.
    """
    if config.tie_lines == 0:
        return []
    choices = []
    for corner in ("south-west", "south-east", "north-west", "north-east"):
        across = LawnmowerConfig(swaths=config.tie_lines, heading_deg=heading_deg + 90.0, start=corner)
        choices.append(reference_lines(area, across).back_and_forth)
    axes = min(choices, key=lambda lines: float(np.hypot(*(lines[0][0] - after))))
    return [Swath(axis, axis) for axis in axes]
