"""Maps of the same recordings by the code of commit e7dc4dd, in a checkout with an environment of its own."""

from benchmarks.earlier_code import CHECKOUT, facts_of
from benchmarks.honest_missions.missions import FOLDER, driven
from benchmarks.stored_parts import stored

_SCRIPT = """
import json, shutil, sys, tempfile, time
from dataclasses import replace
from pathlib import Path
import numpy as np
from survey.area import SurveyArea
from survey.dem import Dem
from survey.grid import Grid
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.recording import Recording
from survey.truth import Truth
from vision_slam import LocalizationConfig
from vision_slam.onboard import read_seen
from vision_slam.pipeline import localize_seen

run = Path(sys.argv[1])

with tempfile.TemporaryDirectory() as place:
    for table in (run / "2-simulate" / "recording").glob("*.csv"):
        shutil.copy(table, place)
    header = json.loads((run / "2-simulate" / "recording" / "recording.json").read_text())
    later = ("camera_height_m", "start_is_surveyed")
    known = {name: value for name, value in header.items() if name not in later}
    (Path(place) / "recording.json").write_text(json.dumps(known))
    recording = Recording.read(place)
seen = read_seen(run / "2-simulate" / "recording" / "onboard")
real, prior = Truth.read(run / "2-simulate" / "truth"), Dem.read(run / "1-plan" / "prior.tif")
bounds = SurveyArea.read(run / "1-plan" / "area.gpkg").bounds
nodes = Grid.over(bounds, (bounds[2] - bounds[0]) / 80.0, prior.crs)
kept = dict(base=None, stakes=None, stake_sightings=None)
assumed = LocalizationConfig(gps_bias_sigma_m=3.0, gps_white_sigma_m=1.0, gps_correlation_time_s=300.0)
spent, choice = [], JointTerrain._hyperparameters


def timed(*given):
    start = time.process_time()
    found = choice(*given)
    spent.append(time.process_time() - start)
    return found


JointTerrain._hyperparameters = timed
path, points, _ = localize_seen(replace(recording, **kept), seen, assumed)
found = JointTerrain(path.error, prior).map(points, nodes).reconstruction
error = found.mean.elevation - real.dem.at(nodes.xy).reshape(nodes.shape)
within = np.abs(error) <= 1.959964 * found.std.elevation
rmse_m, coverage = float(np.sqrt(np.mean(error**2))), float(within.mean())
print(json.dumps({"rmse_m": rmse_m, "coverage": coverage, "kernel_s": sum(spent), "landmarks": len(points)}))
"""


def earlier_map(pattern: str, seed: int) -> dict[str, float] | None:
    """Return the earlier code's map with the unbiased prior and without stakes, or None without a checkout.

    Its RMSE [m], its coverage of 95 %, the CPU time of the choice of its kernel [s], and its landmarks.
    """
    file = FOLDER / "earlier" / f"{pattern}-{seed}.json"
    if CHECKOUT is None and not file.exists():
        return None
    facts: dict[str, float] = stored(file, lambda: facts_of(_SCRIPT, str(driven(pattern, seed).resolve())))
    return facts
