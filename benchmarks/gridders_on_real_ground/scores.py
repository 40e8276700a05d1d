"""Scores of surfaces on all nodes of a survey, stored as they are found."""

import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from subprocess import CalledProcessError
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats import norm

from benchmarks.gridders_on_real_ground.gridders import OURS, PEERS, Gridder, Surface, quietly
from benchmarks.gridders_on_real_ground.surveys import LINES, SCATTERED, Survey, survey_of
from benchmarks.promise_on_real_ground.windows import LANDSCAPES, windows
from benchmarks.stored_parts import code_digest, stored
from survey.core.arrays import FloatArray

Half = Literal["development", "judgement"]
_HERE = "benchmarks/gridders_on_real_ground"
_GROUND = (f"{_HERE}/surveys.py", "benchmarks/promise_on_real_ground/windows.py", "benchmarks/landmarks.py")
_MOST_WINDOWS, _N_WITH_GROUND_POINTS = 6, 2
_STD_95 = float(norm.ppf(0.975))


@dataclass(frozen=True)
class Score:
    """Root mean square error [m]; share of nodes within the 95 % interval and CRPS [m], NaN where no deviation is stated."""

    rmse_m: float
    coverage: float = float("nan")
    crps_m: float = float("nan")


def score_of(surface: Surface, truth: FloatArray) -> Score:
    """Judge heights (M,) and their standard deviations [m]."""
    error = surface.mean - truth
    rmse_m = float(np.sqrt(np.mean(error**2)))
    if surface.std is None:
        return Score(rmse_m)
    covered = float(np.mean(np.abs(error) <= _STD_95 * surface.std))
    return Score(rmse_m, covered, crps_m(error, surface.std))


def crps_m(error: FloatArray, std: FloatArray) -> float:
    """Return the mean continuous ranked probability score of normal distributions [m].

    Gneiting and Raftery, J. Am. Stat. Assoc. 102, 2007, eq. 21.
    """
    z = error / std
    return float(np.mean(std * (z * (2.0 * norm.cdf(z) - 1.0) + 2.0 * norm.pdf(z) - 1.0 / np.sqrt(np.pi))))


class Case(NamedTuple):
    """A survey by its window and kind."""

    landscape: str
    window: int
    kind: str

    def __str__(self) -> str:
        return f"{self.landscape} {self.window}, {self.kind}"


def cases(half: Half, *, quick: bool) -> Iterator[Case]:
    """Yield the surveys of a half: lines on at most six windows of each landscape, taken evenly, landmarks on the middle one.

    Ground points lie on the middle one of the first two landscapes alone, for the others need minutes of each. A quick run
    takes the middle window of two landscapes, with the two sparser lines.
    """
    landscapes = [one.name for one in LANDSCAPES if one.half == half]
    for number, landscape in enumerate(landscapes[: 2 if quick else None]):
        n = len(windows(landscape))
        evenly = np.linspace(0, n - 1, min(n, _MOST_WINDOWS)).round().astype(int).tolist()
        for index in (n // 2,) if quick else evenly:
            yield from (Case(landscape, index, kind) for kind in list(LINES)[: 2 if quick else None])
        if not quick:
            kinds = SCATTERED[: None if number < _N_WITH_GROUND_POINTS else 1]
            yield from (Case(landscape, n // 2, kind) for kind in kinds)


@dataclass(frozen=True)
class Judged:
    """Scores of the maps of one survey, by gridder."""

    case: Case
    scores: dict[str, Score]

    @property
    def without(self) -> Score:
        """Score of our map from the samples alone."""
        return self.scores[OURS[0].name]

    @property
    def with_prior(self) -> Score:
        """Score of our map with the prior."""
        return self.scores[OURS[1].name]

    @cached_property
    def peers(self) -> dict[str, Score]:
        """Scores of the others."""
        return {peer.name: self.scores[peer.name] for peer in PEERS if peer.name in self.scores}

    @property
    def best_peer_m(self) -> float:
        """Least error of the others [m]."""
        return min(score.rmse_m for score in self.peers.values())

    @property
    def best_crps_m(self) -> float:
        """Least CRPS of the others that state a deviation [m]."""
        return float(np.nanmin([score.crps_m for score in self.peers.values()]))


def judged(case: Case) -> Judged:
    """Return the scores of the installed gridders; one that fails on a survey has none there."""
    found = {}
    for gridder in (*OURS, *PEERS):
        if gridder.is_installed:
            facts = stored(_file(case, gridder), partial(_facts, case, gridder))
            if facts:
                found[gridder.name] = Score(**facts)
    return Judged(case, found)


def missing(gridders: Iterable[Gridder] = PEERS) -> list[str]:
    """Return the names of the gridders that are not installed."""
    return [gridder.name for gridder in gridders if not gridder.is_installed]


def _facts(case: Case, gridder: Gridder) -> dict[str, float]:
    """Return the score of a gridder on a survey; nothing where the gridder finds no surface."""
    survey = _survey(case)
    try:
        surface = quietly(gridder, survey)
    except (ValueError, RuntimeError, np.linalg.LinAlgError, CalledProcessError):
        if gridder in OURS:
            raise
        return {}
    return asdict(score_of(surface, survey.truth)) if np.isfinite(surface.mean).all() else {}


@cache
def _survey(case: Case) -> Survey:
    return survey_of(*case)


def _file(case: Case, gridder: Gridder) -> Path:
    """Return where a score is stored: another folder for other code of the surveys, of the peers or of our maps."""
    name = "-".join((*map(str, case), gridder.name)).replace(" ", "_").replace("/", "_")
    return _folder(is_ours=gridder in OURS) / f"{name}.json"


@cache
def _folder(*, is_ours: bool) -> Path:
    made_by = "survey" if is_ours else f"{_HERE}/gridders.py"
    return Path(tempfile.gettempdir()) / "firnline-gridders" / code_digest((*_GROUND, made_by))
