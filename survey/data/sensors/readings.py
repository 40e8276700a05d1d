"""Readings of all sensors during a stretch of a drive, as they arrive on board."""

from dataclasses import dataclass

from survey.data.camera.frames import Image
from survey.data.sensors.aiding import GpsFixes
from survey.data.sensors.tables import SensorTables


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Readings(SensorTables):
    """Records of all sensors during a stretch of time; None for one without readings.

    The records are those of a `survey.data.recording.Recording`; `frame` is the image at the end
    of the stretch, with the time that the camera's clock shows.
    """

    gps: GpsFixes | None = None
    frame: tuple[float, Image] | None = None
