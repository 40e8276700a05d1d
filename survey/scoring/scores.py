"""Score of a survey against a reference terrain, node by node.

`score` compares a map in memory with a reference: it interpolates the reference bilinearly to the nodes of the
map, takes errors and stated standard deviations there, and returns a `Score` with error statistics,
calibration, coverage and verdicts. Maps of elevation in one CRS and above one vertical datum can be compared.
Rasters that do not fit into memory are scored by `survey.scoring.blocks`, errors at checkpoints by
`survey.scoring.standards`.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from survey.core import (
    BoolArray,
    DataObject,
    FloatArray,
    InputError,
    check_types,
    same_crs,
    same_vertical_datum,
)
from survey.data.area import SurveyArea
from survey.data.conversions import html_table
from survey.data.dem import Dem
from survey.data.route import Route
from survey.reconstruction.terrain_map import ELEVATION, Reconstruction
from survey.scoring.accuracy import Calibration, ErrorStatistics
from survey.scoring.coverage import Coverage, NodeCounts, count_nodes, nodes_beyond
from survey.scoring.standards.map_classes import Verdict, judge


@dataclass(frozen=True, eq=False, repr=False)
class Score(DataObject):
    """How good a survey was.

    Parameters
    ----------
    coverage : Coverage
        What the route sampled; its values are ``None`` without a route.
    elevation : ErrorStatistics
        Errors of the map at the nodes that were scored.
    calibration : Calibration
        Calibration of its standard deviations there.
    verdicts : tuple of Verdict
        Classes of the map, the loosest first.
    n_outside : int
        Nodes that were left out because they lie outside the area.
    n_unknown : int
        Nodes in the area where the map gives a height and the reference none.
    n_silent : int
        Nodes in the area where the map gives no height, those beyond the edge of its raster included.
    """

    coverage: Coverage
    elevation: ErrorStatistics
    calibration: Calibration
    verdicts: tuple[Verdict, ...]
    n_outside: int = 0
    n_unknown: int = 0
    n_silent: int = 0

    @property
    def covered_share(self) -> float:
        """Share of the area on which the map gives a height.

        The error statistics of a map that covers less than all are those of the covered part alone.
        """
        covered = self.elevation.n + self.n_unknown
        return covered / (covered + self.n_silent)

    @classmethod
    def judged(
        cls, coverage: Coverage, elevation: ErrorStatistics, calibration: Calibration, nodes: NodeCounts
    ) -> Self:
        """Return the score with the verdicts that follow from the RMSE and the covered share.

        Parameters
        ----------
        coverage : Coverage
            Of the route.
        elevation : ErrorStatistics
            Errors at the nodes that were scored.
        calibration : Calibration
            Of the stated deviations there.
        nodes : NodeCounts
            Nodes that were left out.

        Returns
        -------
        Score
            With one verdict for each row of the standard.
        """
        score = cls(coverage, elevation, calibration, (), nodes.outside, nodes.unknown, nodes.silent)
        return replace(score, verdicts=judge(elevation.rmse_m, covered_share=score.covered_share))

    def _facts(self) -> dict[str, str]:
        elevation, verdicts = self.elevation, [verdict for verdict in self.verdicts if verdict.met]
        return {
            "RMSE": f"{elevation.rmse_m:.3f} m",
            "bias": f"{elevation.bias_m:+.3f} m",
            "NMAD": f"{elevation.nmad_m:.3f} m",
            "nodes": f"{elevation.n}",
            "covered": f"{100.0 * self.covered_share:.1f} %",
            "best class met": verdicts[-1].map_class if verdicts else "none",
        }

    def _summary(self) -> str:
        return ", ".join(f"{name} {value}" for name, value in self._facts().items())

    def _repr_html_(self) -> str:
        return html_table("Score", self._facts())

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, units in the keys; ``None`` where a value does not exist.

        Returns
        -------
        dict
            Nested dictionaries and lists of str, int, float, bool and None.
        """
        plain: dict[str, Any] = _without_nan({**asdict(self), "covered_share": self.covered_share})
        return plain

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Rebuild a score from what `to_dict` gave.

        Parameters
        ----------
        values : mapping
            As `to_dict` returns them.

        Returns
        -------
        Score
            Equal to the one that was converted.

        Raises
        ------
        InputError
            When a part is missing or unknown.
        """
        try:
            return cls(
                coverage=Coverage(**values["coverage"]),
                elevation=ErrorStatistics(**_with_nan(values["elevation"])),
                calibration=_calibration(values["calibration"]),
                verdicts=tuple(Verdict(**verdict) for verdict in values["verdicts"]),
                **{name: int(values[name]) for name in ("n_outside", "n_unknown", "n_silent")},
            )
        except (KeyError, TypeError) as error:
            raise InputError(
                f"the score is incomplete or not firnline's ({error}); score the survey again."
            ) from error


@check_types
def score(
    reconstruction: Reconstruction | Dem,
    *,
    truth: Dem,
    route: Route | None = None,
    area: SurveyArea | None = None,
    sample_step_m: float = 10.0,
) -> Score:
    """Judge a map, and the route that led to it, against a reference terrain.

    Parameters
    ----------
    reconstruction : Reconstruction or Dem
        The map of elevation; judged at its own nodes. A bare DEM claims no uncertainty, so
        there is no calibration.
    truth : Dem
        The reference, interpolated bilinearly to those nodes.
    route : Route, optional
        What was driven; without it there is no coverage.
    area : SurveyArea, optional
        Only nodes on its free ground count, and where the map has no height, its raster's edge included, the
        area is not covered. By default all nodes of the map count at which it or the reference has a height.
    sample_step_m : float
        Distance between samples along the route, and width of the cells of Eq. 11 [m].

    Returns
    -------
    Score
        Nodes left out are counted in it, each under its reason. No class is met below a covered share of
        99.9 %.

    Raises
    ------
    InputError
        Mixed CRS or vertical datums, a map of another quantity, or no node at which
        map, area and reference meet.

    Notes
    -----
    The RMSE is that of the whole surface. Standards judge independent check points of higher
    accuracy instead; the verdicts say so.

    Examples
    --------
    >>> import numpy as np
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 40.0), 10.0)
    >>> flat, sure = Dem.on(grid, np.zeros(grid.shape)), Dem.on(grid, np.full(grid.shape, 0.1))
    >>> high = Dem.on(grid, np.full(grid.shape, 0.2))
    >>> result = score(Reconstruction(high, sure, np.full(grid.shape, 3), "gp", {}), truth=flat)
    >>> result.elevation.rmse_m, result.calibration.z_rms, result.verdicts[0].met
    (0.2, 2.0, True)
    """
    mean, std = mean_and_std(reconstruction)
    check_systems(mean, truth, area)
    ground = area or SurveyArea.rectangle(mean.grid().bounds, mean.crs)
    compared = compare_nodes(mean, std, truth, area)
    return Score.judged(
        Coverage() if route is None else Coverage.of(route, ground, sample_step_m),
        ErrorStatistics.of(compared.errors),
        Calibration.of(compared.errors, compared.std),
        compared.nodes,
    )


def _calibration(values: Mapping[str, Any]) -> Calibration:
    known = _with_nan({**values, "shares": [math.nan if s is None else s for s in values["shares"]]})
    return Calibration(**{**known, "levels": tuple(known["levels"]), "shares": tuple(known["shares"])})


def _with_nan(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: math.nan if value is None else value for key, value in values.items()}


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class NodeComparison(NamedTuple):
    """Errors and stated deviations (N,) [m] where they exist, the counts of nodes, and which nodes were scored."""

    errors: FloatArray
    std: FloatArray
    nodes: NodeCounts
    scored: BoolArray


def mean_and_std(reconstruction: Reconstruction | Dem) -> tuple[Dem, FloatArray]:
    """Return the heights and their claimed deviations (H, W) [m], NaN where nothing is claimed."""
    if isinstance(reconstruction, Dem):
        return reconstruction, np.full(reconstruction.shape, np.nan)
    if reconstruction.quantity != ELEVATION:
        raise InputError(f"the map shows {reconstruction.quantity}; only maps of {ELEVATION} can be scored.")
    return reconstruction.mean, reconstruction.std.elevation


def compare_nodes(mean: Dem, std: FloatArray, truth: Dem, area: SurveyArea | None) -> NodeComparison:
    """Return the errors of the map at the nodes where area, reference and map have a value."""
    nodes = mean.xy
    heights, reference = mean.elevation.ravel(), np.full(len(nodes), np.nan)
    inside = np.ones(len(nodes), dtype=bool) if area is None else area.contains(nodes)
    reference[inside] = truth.at(nodes[inside])
    scored = inside & np.isfinite(reference) & np.isfinite(heights)
    if not scored.any():
        n_known = int(np.isfinite(reference).sum())
        raise InputError(
            f"there is nothing to score: of {len(nodes)} nodes of the map {int(inside.sum())} lie in the area, "
            f"{n_known} of those on the reference and {int(scored.sum())} have a height in both; check that the three overlap."
        )
    counts = count_nodes(heights, reference, inside, has_area=area is not None)
    beyond = 0 if area is None else nodes_beyond(mean.bounds, mean.step_m, area)
    return NodeComparison(
        (heights - reference)[scored],
        std.ravel()[scored],
        counts._replace(silent=counts.silent + beyond),
        scored,
    )


def check_systems(mean: Dem, truth: Dem, area: SurveyArea | None) -> None:
    """Refuse what cannot be compared."""
    same_crs(mean.crs, truth.crs, "the map and the reference")
    same_vertical_datum(mean.vertical_datum, truth.vertical_datum, "the map and the reference")
    if area is not None:
        area.require_crs(mean.crs, "the map")
