"""Schemas of Foxglove as JSON Schema, of which the parts that are written are stated, and values in their form."""

from typing import Any

from survey.core import FloatArray


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


_NUMBER, _TEXT, _WHOLE = {"type": "number"}, {"type": "string"}, {"type": "integer"}
_BYTES = {"type": "string", "contentEncoding": "base64"}
_TIME = _object(sec=_WHOLE, nsec=_WHOLE)
_POSE = _object(
    position=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER),
    orientation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
)
_STAMP = {"timestamp": _TIME, "frame_id": _TEXT}
_FIELD = _object(name=_TEXT, offset=_WHOLE, type=_WHOLE)
SCHEMAS: dict[str, dict[str, Any]] = {
    "PoseInFrame": _object(**_STAMP, pose=_POSE, position_covariance={"type": "array", "items": _NUMBER}),
    "PosesInFrame": _object(**_STAMP, poses={"type": "array", "items": _POSE}),
    "PointCloud": _object(
        **_STAMP, pose=_POSE, point_stride=_WHOLE, fields={"type": "array", "items": _FIELD}, data=_BYTES
    ),
    "CompressedImage": _object(**_STAMP, data=_BYTES, format=_TEXT),
}
"""By the name of the schema without ``foxglove.``; σ and covariances are more than Foxglove's have."""


def xyz(position: FloatArray) -> dict[str, float]:
    """Return a place (3,) as Foxglove writes it."""
    return dict(zip("xyz", position.tolist(), strict=True))
