"""Messages of MCAP files: JSON of Foxglove's schemas.

The frame ``local`` is the survey's CRS with the first pose of the path as its origin, since positions in the CRS have too many
digits for the single precision of viewers; the metadata record ``frame`` holds the origin and the CRS.
"""

import base64
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from mcap.writer import Writer
from pyproj import CRS

from live.export.schemas import SCHEMAS
from survey.core.arrays import FloatArray
from survey.data.grid import Grid

_NANO, _FLOAT32 = 10**9, 7
_FRAME = "local"


class McapMessages:
    """Messages in a local frame; channels are registered when they are first used.

    Parameters
    ----------
    writer : mcap.writer.Writer
        Of the file.
    origin : (3,) ndarray
        Easting, northing and height of the frame's origin [m].
    """

    def __init__(self, writer: Writer, origin: FloatArray) -> None:
        self.writer, self.origin = writer, origin
        self.counts: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def begin(self, crs: CRS) -> None:
        """Write the header, and the frame as metadata.

        Parameters
        ----------
        crs : CRS
            Of the survey.
        """
        self.writer.start(profile="", library="firnline")
        east, north, up = (repr(float(value)) for value in self.origin)
        frame = {"frame_id": _FRAME, "crs": crs.to_wkt(), "east_m": east, "north_m": north, "up_m": up}
        self.writer.add_metadata("frame", frame)

    def add(self, topic: str, schema: str, time_s: float, content: dict[str, Any]) -> None:
        """Write one message.

        Parameters
        ----------
        topic : str
            Name of its channel.
        schema : str
            Name in `live.export.schemas.SCHEMAS`.
        time_s : float
            Of the message [s].
        content : dict
            Without time and frame.
        """
        if topic not in self._channels:
            text = json.dumps(SCHEMAS[schema]).encode()
            kind = self.writer.register_schema(f"foxglove.{schema}", "jsonschema", text)
            self._channels[topic] = self.writer.register_channel(topic, "json", kind)
        stamp = round(time_s * _NANO)
        at = {"sec": stamp // _NANO, "nsec": stamp % _NANO}
        data = json.dumps({"timestamp": at, "frame_id": _FRAME, **content}).encode()
        self.writer.add_message(self._channels[topic], stamp, data, stamp)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def add_map(self, grid: Grid, fields: tuple[FloatArray, FloatArray], time_s: float) -> None:
        """Write heights and standard deviations of a map's nodes as points, since grids of viewers are flat.

        Parameters
        ----------
        grid : Grid
            Nodes.
        fields : tuple of (H, W) ndarray
            Heights and standard deviations [m]; nodes without them are left out.
        time_s : float
            Of the map [s].
        """
        rows = np.column_stack([grid.xy, *(field.ravel() for field in fields)])
        rows = rows[np.isfinite(rows).all(axis=1)]
        rows[:, :3] -= self.origin
        content = {"pose": AT_ORIGIN, **packed_points(rows.astype("<f4"), ("x", "y", "z", "sigma"))}
        self.add("/map", "PointCloud", time_s, content)


AT_ORIGIN = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}


def xyz(position: FloatArray) -> dict[str, float]:
    """Return a place (3,) as Foxglove writes it."""
    return dict(zip("xyz", position.tolist(), strict=True))


def packed_points(rows: Any, names: Sequence[str]) -> dict[str, Any]:
    """Return rows (N, K) of single precision as the fields of a point cloud."""
    size = rows.dtype.itemsize
    described = [{"name": name, "offset": size * k, "type": _FLOAT32} for k, name in enumerate(names)]
    packed = base64.b64encode(np.ascontiguousarray(rows).tobytes()).decode()
    return {"point_stride": size * len(names), "fields": described, "data": packed}
