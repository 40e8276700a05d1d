"""Compare the filter of ground with other programs on labelled airborne clouds: ``python -m benchmarks.ground_filter``.

Labels are the classes in the files; all programs see the points without noise and without classes, with their default settings.
``pdal`` (SMRF) is left out where the program is not installed, and the cloth simulation filter where its package is not
(``pip install firnline[peers]``). The table goes to ``results/benchmarks/ground_filter.json``.
"""

import json
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
from scipy.interpolate import LinearNDInterpolator

from benchmarks.change_pairs import DATA
from benchmarks.writer import TABLES, Run
from survey.core import BoolArray, FloatArray
from survey.data.ground_filter import GroundSurface

RESULT = TABLES / "ground_filter.json"
CLOUDS = {
    **{f"wooded slope {k}": f"lidar_bcts_3strips/bcts_{k}.laz" for k in range(1, 5)},
    "steep forest": "lidar_coromandel_2strips/points.laz",
    "gullied hill, ground alone": "dem_gullies_santacruz_pozo/Blanca_in_Pozo_cl2_SC12.laz",
}
"""Files by what they show; in the last one every point is ground, so that it has errors of type I alone."""
_GROUND, _NOISE = 2, (7, 18)
_EVERY = 7


class Cloud(NamedTuple):
    """Points (N, 3) [m], which are ground by their label, and which are the last return of their pulse (N,)."""

    xyz: FloatArray
    is_ground: BoolArray
    is_last: BoolArray

    @classmethod
    def read(cls, file: Path) -> "Cloud":
        """Read a file without its noise."""
        las = laspy.read(file, laz_backend=laspy.LazBackend.Lazrs)
        classes = np.asarray(las.classification)
        kept = ~np.isin(classes, _NOISE)
        last = np.asarray(las.return_number) >= np.asarray(las.number_of_returns)
        return cls(np.column_stack([las.x, las.y, las.z])[kept], classes[kept] == _GROUND, last[kept])

    def scores(self, found: BoolArray) -> dict[str, float]:
        """Return errors of both types, the total error, Cohen's kappa, and how far the points found lie above the labelled ground [m]."""
        n, truth = len(found), self.is_ground
        rejected, accepted = int((truth & ~found).sum()), int((~truth & found).sum())
        agreed = 1.0 - (rejected + accepted) / n
        chance = truth.mean() * found.mean() + (1.0 - truth.mean()) * (1.0 - found.mean())
        above = self._above_ground(found)
        return {
            "type_1": round(rejected / max(int(truth.sum()), 1), 4),
            "type_2": round(accepted / max(int((~truth).sum()), 1), 4),
            "total": round(1.0 - agreed, 4),
            "kappa": round(float((agreed - chance) / (1.0 - chance)) if chance < 1.0 else 0.0, 4),
            "median_above_m": round(float(np.median(above)), 3),
            "rms_above_m": round(float(np.sqrt(np.mean(above**2))), 3),
        }

    def _above_ground(self, found: BoolArray) -> FloatArray:
        """Return how far every seventh point found lies above the triangles of the labelled ground [m]."""
        xyz = self.xyz - self.xyz[0]
        triangles = LinearNDInterpolator(xyz[self.is_ground, :2], xyz[self.is_ground, 2])
        some = xyz[found][::_EVERY]
        above: FloatArray = some[:, 2] - triangles(some[:, :2])
        return above[np.isfinite(above)]


def by_firnline(cloud: Cloud) -> BoolArray:
    """Return the ground that firnline finds among the last returns."""
    found = cloud.is_last.copy()
    last = cloud.xyz[cloud.is_last]
    found[cloud.is_last] = GroundSurface.through(last).is_ground(last)
    return found


def by_cloth(cloud: Cloud) -> BoolArray:
    """Return the ground that the cloth simulation filter finds among the last returns."""
    import CSF  # type: ignore[import-not-found,import-untyped,unused-ignore]

    cloth, ground, others = CSF.CSF(), CSF.VecInt(), CSF.VecInt()
    cloth.setPointCloud(cloud.xyz[cloud.is_last] - cloud.xyz[0])
    cloth.do_filtering(ground, others, False)
    found = np.zeros(len(cloud.xyz), dtype=np.bool_)
    found[np.flatnonzero(cloud.is_last)[np.asarray(ground)]] = True
    return found


def by_pdal(cloud: Cloud) -> BoolArray:
    """Return the ground that filters.smrf of PDAL finds; it takes last returns by itself."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "source.las", Path(folder) / "target.las"
        _write_bare(cloud, source)
        pipeline = [
            str(source),
            {"type": "filters.smrf"},
            {"type": "writers.las", "filename": str(target), "forward": "all"},
        ]
        subprocess.run(["pdal", "pipeline", "--stdin"], input=json.dumps(pipeline).encode(), check=True)
        made = laspy.read(target)
        found = np.zeros(len(cloud.xyz), dtype=np.bool_)
        is_ground = np.asarray(made.classification) == _GROUND
        found[np.asarray(made.gps_time)[is_ground].astype(np.int64)] = True
        return found


def _write_bare(cloud: Cloud, file: Path) -> None:
    """Write points without classes, their number as the time, as programs may write them in another order."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.floor(cloud.xyz.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.xyz.T
    las.gps_time = np.arange(float(len(cloud.xyz)))
    las.number_of_returns = np.full(len(cloud.xyz), 2, dtype=np.uint8)
    las.return_number = np.where(cloud.is_last, 2, 1).astype(np.uint8)
    las.write(str(file))


def programs() -> dict[str, Callable[[Cloud], BoolArray]]:
    """Return the programs that are installed, by name; print which are not."""
    found: dict[str, Callable[[Cloud], BoolArray]] = {"firnline": by_firnline}
    for name, run, is_there in (
        ("pdal", by_pdal, shutil.which("pdal") is not None),
        ("cloth simulation filter", by_cloth, find_spec("CSF") is not None),
    ):
        if is_there:
            found[name] = run
        else:
            print(f"{name} is not installed and is left out")
    return found


def _cpu_s() -> float:
    """Return the CPU time of this process and of the programs that it ran [s]."""
    own, programs_run = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + programs_run.ru_utime + programs_run.ru_stime


def measure() -> None:
    """Filter every cloud by every program, and store the table."""
    run, rows = Run.begin(measure, RESULT), []
    chosen = programs()
    for name, file in CLOUDS.items():
        cloud = Cloud.read(DATA / file)
        row: dict[str, Any] = {"cloud": name, "points": len(cloud.xyz), "ground": int(cloud.is_ground.sum())}
        for program, find in chosen.items():
            began = _cpu_s()
            found = find(cloud)
            cpu_s = round(_cpu_s() - began, 1)
            row[program] = {**cloud.scores(found), "cpu_s": cpu_s}
        rows.append(row)
        print(json.dumps(row))
    run.write({"command": "python -m benchmarks.ground_filter", "programs": list(chosen), "clouds": rows})


if __name__ == "__main__":
    measure()
