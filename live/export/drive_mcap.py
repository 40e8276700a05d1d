"""MCAP file of a watched survey: places of the rover, samples with their σ, and the map after each update."""

from pathlib import Path

import numpy as np
from mcap.writer import Writer

from live.export.mcap_messages import AT_ORIGIN, McapMessages, packed_points, xyz
from live.watch.log import replayed_states
from live.watch.survey_watch import SurveyWatch
from survey.core.errors import InputError
from survey.core.files import replacing

_UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def write_drive_mcap(log: Path, path: Path) -> dict[str, int]:
    """Replay the log of a watch, and write what it shows.

    Parameters
    ----------
    log : pathlib.Path
        Of ``firnline watch --log``.
    path : pathlib.Path
        File to write.

    Returns
    -------
    dict
        Number of messages by topic.

    Raises
    ------
    InputError
        A file that is no log, or a log without a sample.
    """
    with replacing(path) as draft, draft.open("wb") as stream:
        mcap: McapMessages | None = None
        for watch, entry in replayed_states(log):
            if mcap is None and watch.samples:
                mcap = McapMessages(Writer(stream), watch.xyz[0])
                mcap.begin(watch.area.crs)
            if mcap is not None and entry.get("event") == "map":
                _write_update(mcap, watch, float(entry["time_s"]))
        if mcap is None:
            raise InputError(f"{log} holds no sample that was taken; name the log of a drive.")
        _write_drive(mcap, watch)
        mcap.writer.finish()  # type: ignore[no-untyped-call]
    return mcap.counts


def _write_update(mcap: McapMessages, watch: SurveyWatch, time_s: float) -> None:
    """Write the map after an update."""
    if watch.latest_map is not None:
        mcap.add_map(watch.grid, watch.latest_map, time_s)


def _write_drive(mcap: McapMessages, watch: SurveyWatch) -> None:
    """Write where the rover was, and the samples with their standard deviations."""
    places = watch.xyz - mcap.origin
    poses = [{"position": xyz(place), "orientation": _UPRIGHT} for place in places]
    for sample, pose in zip(watch.samples, poses, strict=True):
        mcap.add("/rover1/pose", "PoseInFrame", sample.time_s, {"pose": pose})
    time_s = watch.samples[-1].time_s
    mcap.add("/rover1/path", "PosesInFrame", time_s, {"poses": poses})
    rows = np.column_stack([places, [sample.sigma_m for sample in watch.samples]]).astype("<f4")
    content = {"pose": AT_ORIGIN, **packed_points(rows, ("x", "y", "z", "sigma_z"))}
    mcap.add("/rover1/samples", "PointCloud", time_s, content)
