"""Errors and speed of a path that a program found on a drive."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from benchmarks.peers_in_vision.drives import PeerDrive
from benchmarks.peers_in_vision.programs import OURS, FoundPath
from benchmarks.report import Row
from survey.core.arrays import FloatArray
from vision_slam.evaluation import absolute_errors_m, alignment, relative_errors

SCALES_FROM_M = (10.0, 40.0)
_STRETCH_M = 10.0
Bar = tuple[Literal["<=", ">="], float]
_LEAST_POSES, _LEAST_M, _MOST_LOST = 10, 20.0, 0.1


@dataclass(frozen=True)
class PathScore:
    """Figures of one program on one drive; NaN where it found no path.

    `end_per_cent`: by the metres of the reference that give the scale. `ate_m`, `ate_per_cent`: after the best similarity,
    also over the travel. `drift_per_cent`: relative error over stretches of 10 m.
    """

    drive: PeerDrive
    program: str
    n_given: int
    n_lost: int
    failed: str = ""
    end_per_cent: dict[float, float] = field(default_factory=dict)
    ate_m: float = float("nan")
    ate_per_cent: float = float("nan")
    drift_per_cent: float = float("nan")
    nees_2d: float = float("nan")
    frames_per_s: float = float("nan")

    @property
    def is_followed(self) -> bool:
        """Whether at most a tenth of the images is lost."""
        return not self.failed and self.n_lost <= _MOST_LOST * self.n_given

    def rows(self) -> Iterator[Row]:
        """Yield the figures; where there is no path, the message of the program."""
        name = f"{self.drive.name}, {self.program}"
        yield Row(f"{name}: images lost of {self.n_given}", float(self.n_lost), "1")
        if self.failed:
            yield Row(f"{name}: no path, {self.failed}", 1.0, "1")
            return
        on_streets, on_snow = not self.drive.is_snow, self.drive.is_snow
        for metres, error in self.end_per_cent.items():
            bar: Bar | None = ("<=", 1.5) if on_streets and metres == min(self.end_per_cent) else None
            yield self._row(f"end error, scale from {metres:g} m", error, "%", bar)
        yield self._row("Sim(3) ATE", self.ate_m, "m", ("<=", 1.3) if on_snow else None)
        yield self._row("Sim(3) ATE over the travel", self.ate_per_cent, "%")
        yield self._row(f"drift over {_STRETCH_M:g} m", self.drift_per_cent, "%")
        if np.isfinite(self.nees_2d):
            yield self._row("NEES, 2-D", self.nees_2d, "1", ("<=", 4.0))
        yield self._row("frames per CPU second", self.frames_per_s, "1/s", (">=", 50.0 if on_snow else 12.0))

    def _row(self, what: str, value: float, unit: str, bar: Bar | None = None) -> Row:
        """Return a row, with its bar where the program is ours."""
        name = f"{self.drive.name}, {self.program}: {what}"
        return Row.of(name, value, unit, *bar) if bar and self.program == OURS else Row(name, value, unit)


def median_run(drive: PeerDrive, program: str, found: Sequence[FoundPath]) -> PathScore:
    """Return the score of the run with the median error of shape; runs without a path are the worst."""
    scores = sorted(
        (score_of(drive, program, one) for one in found),
        key=lambda one: np.nan_to_num(one.ate_m, nan=np.inf),
    )
    return scores[len(scores) // 2]


def score_of(drive: PeerDrive, program: str, found: FoundPath) -> PathScore:
    """Judge one path by the reference of its drive."""
    counts = found.n_given, found.n_given - len(found.index)
    real = drive.reference[found.index]
    travel = _travel_m(real[:, :3, 3])
    if len(found.index) < _LEAST_POSES or travel[-1] < _LEAST_M:
        followed = f"the largest map has {len(found.index)} images of {travel[-1]:.0f} m"
        return PathScore(drive, program, *counts, failed=found.failed or followed)
    place, at = found.poses[:, :3, 3], real[:, :3, 3]
    ate_m = float(np.sqrt(np.mean(absolute_errors_m(place, at, "sim3") ** 2)))
    scaled = found.poses.copy()
    scaled[:, :3, 3] *= alignment(place, at).scale
    drift_m, _ = relative_errors(scaled, real, _STRETCH_M)
    return PathScore(
        drive,
        program,
        *counts,
        end_per_cent={metres: _end_per_cent(found.poses, real, travel, metres) for metres in SCALES_FROM_M},
        ate_m=ate_m,
        ate_per_cent=100.0 * ate_m / float(travel[-1]),
        drift_per_cent=100.0 * float(np.sqrt(np.mean(drift_m**2))) / _STRETCH_M,
        nees_2d=found.nees_2d,
        frames_per_s=found.n_given / found.cpu_s,
    )


def _travel_m(place: FloatArray) -> FloatArray:
    """Return the travel (N,) up to each place [m]."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1)))


def _end_per_cent(poses: FloatArray, real: FloatArray, travel: FloatArray, metres: float) -> float:
    """Return the error of the last pose over the travel [%], with the first pose and the scale of the first metres given."""
    own, true = ((one[:, :3, 3] - one[0, :3, 3]) @ one[0, :3, :3] for one in (poses, real))
    first = travel <= metres
    scale = float((own[first] * true[first]).sum() / (own[first] ** 2).sum())
    return 100.0 * float(np.linalg.norm(scale * own[-1] - true[-1])) / float(travel[-1])
