"""Score of a survey against a reference terrain, node by node, in memory or block by block.

`score` compares a map in memory with a reference: it interpolates the reference bilinearly to the nodes of the
map, takes errors and stated standard deviations there, and returns a `Score` with error statistics,
calibration, coverage and verdicts. Maps of elevation in one CRS and above one vertical datum can be compared.
`score_files` reads rasters that do not fit into memory in blocks, in one pass, with the same result: `ErrorSketch`
holds the distribution of the errors as a histogram with bins even in asinh(e / 1 mm): moments are exact to rounding,
median, NMAD and percentile to 2e-5 of their distance from the first block's median. `CalibrationSketch` counts errors
within nominal intervals. Errors at checkpoints are scored by `survey.scoring.standards`.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from affine import Affine
from scipy.special import ndtri

from survey.core import (
    BoolArray,
    Bounds,
    DataObject,
    FloatArray,
    InputError,
    IntArray,
    agreed_crs,
    existing_file,
    same_crs,
    same_vertical_datum,
)
from survey.core.arguments import check_types
from survey.data.area import SurveyArea
from survey.data.conversions import html_table
from survey.data.dem import Dem
from survey.data.route import Route
from survey.io.raster import open_raster, read_window
from survey.io.raster.large import system_of
from survey.io.raster.reading import log_scale
from survey.io.raster.values import Extremes
from survey.reconstruction.terrain_map import ELEVATION, Reconstruction
from survey.scoring.accuracy import LEVELS, NMAD_FACTOR, Calibration, ErrorStatistics
from survey.scoring.coverage import Coverage, NodeCounts, count_nodes, nodes_beyond
from survey.scoring.standards.map_classes import Verdict, edition_2_class, judge
from survey.scoring.standards.standards import LEAST_COVERED


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
        elevation, is_covered = self.elevation, self.covered_share >= LEAST_COVERED
        return {
            "RMSE": f"{elevation.rmse_m:.3f} m",
            "bias": f"{elevation.bias_m:+.3f} m",
            "NMAD": f"{elevation.nmad_m:.3f} m",
            "nodes": f"{elevation.n}",
            "covered": f"{100.0 * self.covered_share:.1f} %",
            "vertical, ASPRS Edition 2": edition_2_class(elevation.rmse_m) if is_covered else "none",
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


BLOCK_CELLS = 1024
"""Side of the blocks that are read at once [cells]."""


def score_files(
    map_file: str | Path,
    reference_file: str | Path,
    area: SurveyArea | None = None,
    *,
    crs: Any = None,
    units: str | None = None,
) -> Score:
    """Judge a raster against a reference raster, of whatever size, block by block.

    What `survey.score` does in memory; a second band of the map is its standard deviation.

    At the edge of the reference, the outer half cell does not count unless a cell beyond it is known.
    """
    errors, calibration = ErrorSketch(), CalibrationSketch()
    nodes = NodeCounts(0, 0, 0)
    with (
        open_raster(existing_file(map_file, "the raster"), units) as map_,
        open_raster(existing_file(reference_file, "the raster"), units) as reference,
    ):
        mapped, known = (
            _Layer.of(map_, map_file, crs, units),
            _Layer.of(reference, reference_file, crs, units),
        )
        same_crs(mapped.crs, known.crs, "the map and the reference")
        same_vertical_datum(mapped.datum, known.datum, "the map and the reference")
        if area is not None:
            area.require_crs(mapped.crs, "the map")
        side = max(2, min(BLOCK_CELLS, int(2 * BLOCK_CELLS * known.transform.a / mapped.transform.a)))
        if area is not None:
            nodes = nodes._replace(silent=nodes_beyond(mapped.bounds, mapped.transform.a, area))
        for block in mapped.blocks(side):
            heights, xy = mapped.read(1, block), mapped.centres(block)
            truth = known.at(xy)
            inside = np.ones(heights.shape, dtype=bool) if area is None else _inside(area, xy)
            both = inside & np.isfinite(heights) & np.isfinite(truth)
            left_out = count_nodes(heights, truth, inside, has_area=area is not None)
            nodes = NodeCounts(*(a + b for a, b in zip(nodes, left_out, strict=True)))
            difference = (heights - truth)[both]
            errors.add(difference)
            if mapped.n_bands > 1:
                calibration.add(difference, mapped.read(2, block)[both])
    for layer, name in ((mapped, map_file), (known, reference_file)):
        layer.extremes.refuse_detached(layer.transform.a, str(name))
    if errors.n == 0:
        raise InputError(
            f"there is nothing to score: {map_file} and {reference_file} have no height in common; check that they overlap."
        )
    return Score.judged(Coverage(), errors.statistics(), calibration.calibration(), nodes)


class _Layer(NamedTuple):
    """An open raster with what `Dem` checks of it."""

    source: Any
    transform: Affine
    crs: Any
    datum: str
    n_bands: int
    extremes: Extremes
    units: str | None

    @classmethod
    def of(cls, source: Any, path: str | Path, crs: Any, units: str | None) -> "_Layer":
        log_scale(source, path, units)
        wkt, datum = system_of(source)
        # A DEM of four cells refuses what no DEM may be: rotated, south-up, oblong.
        system = agreed_crs(wkt, crs, str(path))
        Dem(np.zeros((2, 2)), source.transform, system)
        if min(source.width, source.height) < 2:
            raise InputError(f"{path} has {source.height} × {source.width} cells; at least 2 × 2 are needed.")
        return cls(source, source.transform, system, datum, source.count, Extremes(), units)

    @property
    def bounds(self) -> Bounds:
        """West, south, east and north of the outer edges [m]."""
        t = self.transform
        return t.c, t.f + t.e * self.source.height, t.c + t.a * self.source.width, t.f

    def blocks(self, side: int) -> Iterator[Any]:
        from rasterio.windows import Window

        for row in range(0, self.source.height, side):
            for column in range(0, self.source.width, side):
                height = min(side, self.source.height - row)
                yield Window(column, row, min(side, self.source.width - column), height)

    def read(self, band: int, block: Any) -> FloatArray:
        values = read_window(self.source, band, block, self.units)
        if band == 1:
            self.extremes.add(values)
        return values

    def centres(self, block: Any) -> tuple[FloatArray, FloatArray]:
        """Return the easting (w,) and northing (h,) of a block's cell centres [m]."""
        t = self.transform
        x = t.c + t.a * (block.col_off + np.arange(block.width) + 0.5)
        y = t.f + t.e * (block.row_off + np.arange(block.height) + 0.5)
        return x, y

    def at(self, xy: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Return the bilinear heights (h, w) on the nodes of two axes; NaN where the raster does not know."""
        from rasterio.windows import Window

        t = self.transform
        u, v = (xy[0] - t.c) / t.a - 0.5, (xy[1] - t.f) / t.e - 0.5
        column, row = (
            _clipped(np.floor(w + 1e-9), n - 2) for w, n in ((u, self.source.width), (v, self.source.height))
        )
        off_c, off_r = int(column.min()), int(row.min())
        window = Window(off_c, off_r, int(column.max()) + 2 - off_c, int(row.max()) + 2 - off_r)
        # Half a cell beyond the outermost centres is the raster's own ground.
        outside_u = (u < -0.5 - 1e-9) | (u > self.source.width - 0.5 + 1e-9)
        outside_v = (v < -0.5 - 1e-9) | (v > self.source.height - 0.5 + 1e-9)
        if outside_u.all() or outside_v.all():
            return np.full((len(v), len(u)), np.nan)
        z = self.read(1, window)
        s, r = u - column, v - row
        heights = _mixed(_mixed(z, column - off_c, s, axis=1), row - off_r, r, axis=0)
        heights[outside_v, :] = np.nan
        heights[:, outside_u] = np.nan
        return heights


def _clipped(index: FloatArray, largest: int) -> IntArray:
    result: IntArray = np.clip(index, 0, largest).astype(np.int64)
    return result


def _mixed(z: FloatArray, index: IntArray, share: FloatArray, *, axis: int) -> FloatArray:
    """Interpolate linearly along one axis; exact at nodes, so that a nodata neighbour of weight 0 does not count."""
    near = np.take(z, index, axis=axis)
    on_node = np.abs(share) < 1e-9
    if on_node.all():
        return near
    far = np.take(z, index + 1, axis=axis)
    weight = share[None, :] if axis == 1 else share[:, None]
    node, next_node = np.abs(weight) < 1e-9, np.abs(weight - 1.0) < 1e-9
    mixed: FloatArray = np.where(node, near, np.where(next_node, far, near + (far - near) * weight))
    return mixed


def _inside(area: SurveyArea, xy: tuple[FloatArray, FloatArray]) -> Any:
    """Return which nodes of two axes lie on free ground."""
    east, north = np.meshgrid(*xy)
    return area.contains(np.column_stack([east.ravel(), north.ravel()])).reshape(east.shape)


# Bins of the errors' distribution: even in asinh(e / 1 mm) about the first block's median, so that each is
# 2e-5 of its distance from there, or 20 nm, wide.
_SCALE_M = 1e-3


_N_BINS = 2_000_000


_FARTHEST = math.asinh(1e6 / _SCALE_M)


_N_BISECTIONS = 80


@dataclass
class ErrorSketch:
    """The distribution of errors that come block by block, in 16 MB whatever their number.

    Mean, RMSE and higher moments are exact to rounding; median, NMAD and percentile to 2e-5 of
    their distance from the first block's median. The largest error is exact.

    >>> errors = np.random.default_rng(1).normal(0.2, 0.5, 20_000)
    >>> sketch = ErrorSketch()
    >>> for part in np.split(errors, 10):
    ...     sketch.add(part)
    >>> sketched, exact = sketch.statistics(), ErrorStatistics.of(errors)
    >>> all(abs(a - b) < 1e-4 for a, b in zip(vars(sketched).values(), vars(exact).values()))
    True
    """

    n: int = 0
    centre_m: float = 0.0
    worst_m: float = 0.0
    _sums: FloatArray = field(default_factory=lambda: np.zeros(4), repr=False)
    _counts: IntArray = field(default_factory=lambda: np.zeros(_N_BINS, dtype=np.int64), repr=False)

    def add(self, errors: FloatArray) -> None:
        """Add errors (N,) [m]; all finite."""
        if len(errors) == 0:
            return
        if self.n == 0:
            self.centre_m = float(np.median(errors))
        offset = errors - self.centre_m
        power = offset.copy()
        for k in range(4):
            self._sums[k] += power.sum()
            power *= offset
        position = (np.arcsinh(offset / _SCALE_M) + _FARTHEST) * (_N_BINS / (2.0 * _FARTHEST))
        index = np.clip(position, 0, _N_BINS - 1).astype(np.int64)
        np.add.at(self._counts, index, 1)
        self.n += len(errors)
        self.worst_m = max(self.worst_m, float(np.abs(errors).max()))

    def statistics(self) -> ErrorStatistics:
        """Return what `ErrorStatistics.of` would give for all errors at once."""
        if self.n == 0:
            raise InputError("there are no errors to summarise; check that the rasters overlap.")
        m1, m2, m3, m4 = self._sums / self.n
        bias = self.centre_m + m1
        variance = max(m2 - m1**2, 0.0)
        third = m3 - 3.0 * m1 * m2 + 2.0 * m1**3
        fourth = m4 - 4.0 * m1 * m3 + 6.0 * m1**2 * m2 - 3.0 * m1**4
        below = np.cumsum(self._counts, dtype=np.float64)
        median = self._within(below, -np.inf, 0.5)
        return ErrorStatistics(
            n=self.n,
            rmse_m=math.sqrt(variance + bias**2),
            bias_m=float(bias),
            std_m=math.sqrt(variance),
            median_m=median,
            nmad_m=NMAD_FACTOR * self._within(below, median, 0.5),
            p95_m=self._within(below, 0.0, 0.95),
            worst_m=self.worst_m,
            skewness=float(third / variance**1.5) if variance > 0.0 else math.nan,
            kurtosis=float(fourth / variance**2 - 3.0) if variance > 0.0 else math.nan,
        )

    def _share_below(self, below: FloatArray, error_m: float) -> float:
        """Return the share of the errors that are not above a value [m], even within a bin."""
        place = (math.asinh((error_m - self.centre_m) / _SCALE_M) + _FARTHEST) * (_N_BINS / (2.0 * _FARTHEST))
        k = int(min(max(place, 0.0), _N_BINS - 1))
        before = below[k - 1] if k else 0.0
        return float(before + (below[k] - before) * min(max(place - k, 0.0), 1.0)) / self.n

    def _within(self, below: FloatArray, centre_m: float, share: float) -> float:
        """Return the distance from a centre within which a share of the errors lies [m]; from -inf, the value itself."""
        one_sided = centre_m == -np.inf
        low, high = (-self.worst_m if one_sided else 0.0), 2.0 * self.worst_m + 1e-12
        for _ in range(_N_BISECTIONS):
            middle = 0.5 * (low + high)
            if one_sided:
                inside = self._share_below(below, middle)
            else:
                inside = self._share_below(below, centre_m + middle) - self._share_below(
                    below, centre_m - middle
                )
            low, high = (middle, high) if inside < share else (low, middle)
        return 0.5 * (low + high)


@dataclass
class CalibrationSketch:
    """The counts of a calibration that come block by block."""

    n: int = 0
    _z_squares: float = 0.0
    _within: FloatArray = field(default_factory=lambda: np.zeros(len(LEVELS) + 1))

    def add(self, errors: FloatArray, std: FloatArray) -> None:
        """Add errors and stated deviations (N,) [m]; NaN deviations do not count."""
        stated = np.isfinite(std)
        e, s = np.abs(errors[stated]), std[stated]
        if (s < 0.0).any():
            raise InputError(f"{int((s < 0.0).sum())} stated standard deviations are negative; correct them.")
        z = np.divide(e, s, out=np.where(e > 0.0, np.inf, 0.0), where=s > 0.0)
        self.n += len(z)
        self._z_squares += float((z**2).sum())
        limits = ndtri(0.5 + 0.5 * np.array([*LEVELS, 0.95]))
        self._within += [(z <= limit).sum() for limit in limits]

    def calibration(self) -> Calibration:
        """Return what `Calibration.of` would give for all at once."""
        if self.n == 0:
            return Calibration.of([], [])
        shares = self._within / self.n
        z_rms = math.sqrt(self._z_squares / self.n)
        return Calibration(LEVELS, tuple(shares[:-1].tolist()), float(shares[-1]), z_rms, self.n)
