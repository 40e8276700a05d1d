"""Logs of autopilots for ``firnline localize``."""

from pathlib import Path
from typing import TYPE_CHECKING

from firnline.cli.live.options import needs_live_extra

if TYPE_CHECKING:
    from vision_slam.recorded_drive import RecordedDrive

LOG_ENDINGS = (".bin", ".tlog", ".ulg")


def opened_log(source: Path, crs: str | None) -> "RecordedDrive":
    """Open the log of an autopilot as a recording."""
    from vision_slam.recorded_drive import RecordedDrive

    with needs_live_extra():
        from live.autopilot_logs import read_autopilot_log

        return RecordedDrive(*read_autopilot_log(source, crs))
