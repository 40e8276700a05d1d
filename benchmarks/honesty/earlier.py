"""Maps of the same surveys by the code of commit e7dc4dd, in a checkout with an environment of its own."""

import json
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.earlier_code import CHECKOUT, facts_of
from benchmarks.honesty.priors import prior
from benchmarks.honesty.surveys import (
    ASSUMED_TAU_S,
    BEFORE,
    MEMORY_MB,
    NODE_SPACING_M,
    NODES,
    TOLERANCE_M,
    recorded,
)
from benchmarks.stored_parts import stored

_SCRIPT = """
import json, sys
from pathlib import Path
import numpy as np
from survey.dem import Dem
from survey.grid import Grid
from survey.reconstruction.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.recording import Recording
from vision_slam import LocalizationConfig, localize

place, settings = Path(sys.argv[1]), json.loads(sys.argv[2])
header = json.loads((place / "recording" / "recording.json").read_text())
later = ("camera_height_m", "start_is_surveyed")
(place / "recording" / "recording.json").write_text(json.dumps({k: v for k, v in header.items() if k not in later}))
recording = Recording.read(place / "recording")
real, cells = Dem.read(place / "real.tif"), Dem.read(place / "prior.tif")
nodes = Grid(tuple(settings["bounds_m"]), settings["step_m"], real.crs)
assumed = LocalizationConfig(**settings["assumed"])
path, points = localize(recording, assumed)
joint = JointConfig(slope_passes=1, memory_mb=settings["memory_mb"])
model = JointTerrain(path.error, cells, GaussianProcessConfig(tolerance_m=settings["tolerance_m"]), joint)
found = model.map(points, nodes).reconstruction
error = found.mean.elevation - real.at(nodes.xy).reshape(nodes.shape)
within = np.abs(error) <= 1.959964 * found.std.elevation
facts = {"rmse_m": np.sqrt(np.mean(error**2)), "offset_m": error.mean(), "coverage": within.mean()}
print(json.dumps({name: float(value) for name, value in facts.items()} | {"landmarks": len(points)}))
"""


def earlier_maps(folder: Path, seeds: range) -> list[dict[str, Any]]:
    """Return the earlier code's maps with a truthful prior, of some kinds of terrain; none without a checkout.

    Each has its terrain, seed, RMSE [m], offset [m] and coverage of 95 %.
    """
    found = []
    for seed in seeds:
        for kind in BEFORE:
            file = folder / f"{kind.replace(' ', '_')}-{seed}.json"
            if CHECKOUT is not None or file.exists():
                facts = stored(file, lambda kind=kind, seed=seed: _mapped(kind, seed))
                found.append(facts | {"terrain": kind, "seed": seed})
    return found


def _mapped(kind: str, seed: int) -> dict[str, float]:
    """Survey a terrain as `survey_of` does, and map it with the earlier code."""
    with tempfile.TemporaryDirectory() as place:
        settings = _write(Path(place), kind, seed)
        return facts_of(_SCRIPT, place, json.dumps(settings))


def _write(place: Path, kind: str, seed: int) -> dict[str, Any]:
    """Write recording, terrain and prior of a survey; return the settings of the estimate."""
    real, _, recording = recorded(kind, seed)
    recording.write(place / "recording")
    real.write(place / "real.tif")
    prior("truthful", real, kind, seed).write(place / "prior.tif")
    assumed = {"node_spacing_m": NODE_SPACING_M, "gps_correlation_time_s": ASSUMED_TAU_S}
    return {
        "bounds_m": NODES.bounds,
        "step_m": NODES.step_m,
        "assumed": assumed,
        "memory_mb": MEMORY_MB,
        "tolerance_m": TOLERANCE_M,
    }
