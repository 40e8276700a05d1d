"""Folders of the parts of the benchmarks on moving ice."""

import os
from pathlib import Path

from benchmarks.stored_parts import ROOT, code_digest

SURVEYS = (
    "vision_slam/fusion",
    "survey/reconstruction/joint",
    *(f"survey/reconstruction/motion/{name}.py" for name in ("epoch", "refinement", "stakes")),
    *(f"benchmarks/moving_ice/{name}.py" for name in ("cases", "chance", "surveys")),
)
"""Code that the outcomes of surveys depend on."""
_ROOT = Path(os.environ.get("FIRNLINE_MOVING_ICE", ROOT / "results" / "runs" / "moving-ice"))


def folder_of(*sources: str) -> Path:
    """Return the folder of parts, another one for other code."""
    return _ROOT / code_digest(sources)
