"""Map the intensity of radiation or of a plume from counts, and find its source."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import survey
from firnline.actions.interface import Preview, WrittenResult, place_of, previewed_by, refuse_existing
from firnline.actions.requests import CountsRequest
from survey.core import ConfigError, FloatArray, InputError, replacing_folder
from survey.core.documents import write_json
from survey.core.streams import stream
from survey.reconstruction.counts.counts import Counts
from survey.reconstruction.counts.intensity import IntensityField, require_counts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OWN_FILES = ("*.tif", "counts.json", "counts.*", "interval.*", "*.aux.xml")
"""Patterns of the files that a map of counts consists of."""
_MOST_NODES, _MOST_IN_SOURCE = 250_000, 300
_INTERVAL = (0.025, 0.975)
_LEAST_WIND_M_S = 0.1
# Orders of magnitude of strengths and backgrounds about what was counted.
_RANGE = (1e-3, 1e6)


class StatedSource(NamedTuple):
    """Place of a source (2,) [m], standard deviations (2,) [m], probability within the radius, and independent counts per count.

    `next_xy`: place of the next count (2,) [m], where it was asked for.
    """

    xy: FloatArray
    sigma_m: FloatArray
    probability: float
    share: float
    next_xy: FloatArray | None


@dataclass(frozen=True)
class CountsResult(WrittenResult):
    """Map of an intensity, and the place of its source where one was asked for.

    Parameters
    ----------
    request : CountsRequest
        What was asked for.
    counts : Counts
        The counts.
    maps : Mapping of str to Dem
        Median, lower and upper end of the 95 % interval [counts/s]; with a limit the probability to be below it.
    found : Mapping
        Hyperparameters of the field.
    source : StatedSource or None
        The source.
    """

    request: CountsRequest
    counts: Counts
    maps: Mapping[str, survey.Dem]
    found: Mapping[str, float | str]
    source: StatedSource | None

    def _write_files(self) -> None:
        """Write rasters, pictures and facts into a folder."""
        with replacing_folder(self.request.out, own=OWN_FILES) as draft:
            for name, dem in self.maps.items():
                dem.write(draft / f"{name}.tif", name)
            write_json(draft / "counts.json", self.facts())
            self.request.write_pictures(draft, self._pictures)

    def _pictures(self) -> "dict[str, Figure]":
        from survey.figures.maps import intensity_map, interval_map

        median = self.maps["intensity"]
        factor = self.maps["upper"].elevation / median.elevation
        circle = None if self.source is None else (self.source.xy, self.request.radius_m)
        wide = survey.Dem(factor, median.transform, median.crs)
        way = self.counts.xy
        return {"counts": intensity_map(median, way, circle), "interval": interval_map(wide, way)}

    def facts(self) -> dict[str, Any]:
        """Return numbers of counts, hyperparameters, and the source."""
        stated: dict[str, Any] = {
            "n_counts": len(self.counts),
            "counted": int(self.counts.n.sum()),
            "exposure_s": float(self.counts.exposure_s.sum()),
            **self.found,
        }
        if self.source is not None:
            east, north = (float(v) for v in self.source.xy)
            stated["source"] = {
                "kind": self.request.source,
                "easting_m": east,
                "northing_m": north,
                "sigma_east_m": float(self.source.sigma_m[0]),
                "sigma_north_m": float(self.source.sigma_m[1]),
                "radius_m": self.request.radius_m,
                "probability_within_radius": self.source.probability,
                "independent_share_of_counts": self.source.share,
            }
            if self.source.next_xy is not None:
                stated["source"]["next_place_m"] = self.source.next_xy.tolist()
        return stated

    def lines(self) -> list[str]:
        """Return counts, field, source, and the place of the map."""
        facts, low, high = self.facts(), self.maps["lower"], self.maps["upper"]
        factor = float(np.nanmedian(np.sqrt(high.elevation / low.elevation)))
        lines = [
            f"{facts['counted']} counts in {facts['exposure_s']:.0f} s at {facts['n_counts']} places: {facts['family']}, length scale "
            f"{facts['length_scale_m']:.0f} m, dispersion {facts['dispersion']:.3g}",
            f"intensity: median of the site {np.nanmedian(self.maps['intensity'].elevation):.3g} counts/s, known within a factor "
            f"of {factor:.3g} (95 %) on half of it",
        ]
        if "below_limit" in self.maps:
            below = self.maps["below_limit"].elevation
            share = float((below[np.isfinite(below)] >= 0.95).mean())
            lines.append(
                f"limit: below {self.request.limit_per_s:g} counts/s with 95 % probability on {100 * share:.0f} % of the ground"
            )
        if self.source is not None:
            (east, north), (sigma_e, sigma_n) = self.source.xy, self.source.sigma_m
            is_open = self.source.probability < 0.5
            lines.append(
                f"source: {'not found, the likeliest place is ' if is_open else ''}{east:.1f} ± {sigma_e:.1f} m E, {north:.1f} ± {sigma_n:.1f} m N; within {self.request.radius_m:g} m with a "
                f"probability of {100 * self.source.probability:.0f} %"
            )
            if self.source.next_xy is not None:
                lines.append("next count: {:.1f} m E, {:.1f} m N".format(*self.source.next_xy))
        return [*lines, f"map: {self.request.out}"]


def preview_counts(request: CountsRequest) -> Preview:
    """Read the counts and the area, and return their numbers."""
    counts, grid, _ = _inputs(request)
    return Preview.of([request.out], {"counts": len(counts), "nodes": int(np.prod(grid.shape))})


@previewed_by(preview_counts)
def count_map(request: CountsRequest) -> CountsResult:
    """Map the intensity of radiation or of a plume from counts, and find its source.

    Parameters
    ----------
    request : CountsRequest
        Counts, grid, and the kind of the source.

    Returns
    -------
    CountsResult
        The map; `CountsResult.write` writes it.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    ConfigError
        A plume without wind, or a half-life without a plume.
    """
    counts, grid, area = _inputs(request)
    field = IntensityField.fit(counts)
    intensity = field.at(grid.xy)
    layers = {
        "intensity": intensity.quantile(0.5),
        "lower": intensity.quantile(_INTERVAL[0]),
        "upper": intensity.quantile(_INTERVAL[1]),
    }
    if request.limit_per_s is not None:
        layers["below_limit"] = intensity.below(request.limit_per_s)
    inside = None if area is None else area.contains(grid.xy)
    maps = {
        name: survey.Dem.on(
            grid, (values if inside is None else np.where(inside, values, np.nan)).reshape(grid.shape)
        )
        for name, values in layers.items()
    }
    found = field.hyperparameters
    facts: dict[str, float | str] = {
        "family": found.family,
        "log_sigma": found.sigma,
        "length_scale_m": found.length_m,
        "dispersion": found.dispersion,
        "stretch_along_wind": found.stretch,
    }
    source = None if request.source == "none" else _source(request, counts, area or _rectangle(grid))
    return CountsResult(request, counts, maps, facts, source)


def _rectangle(grid: survey.Grid) -> survey.SurveyArea:
    return survey.SurveyArea.rectangle(grid.bounds, grid.crs)


def _source(request: CountsRequest, counts: Counts, area: survey.SurveyArea) -> StatedSource:
    """Find the source in the area, and the place of the next count."""
    from planners.source_search import SourceSeeker
    from survey.reconstruction.counts.sources import InverseSquare, SourcePrior, SourceSearch, SteadyPlume

    response = (
        InverseSquare(height_m=request.height_m)
        if request.source == "radiation"
        else SteadyPlume(height_m=request.height_m, half_life_s=request.half_life_s or np.inf)
    )
    mean = float(counts.n.sum() / counts.exposure_s.sum())
    strengths, backgrounds = ((mean * 1e-1, mean * _RANGE[1]), (mean * _RANGE[0], mean * 10.0))
    prior = SourcePrior(area.bounds, strengths, backgrounds)
    search = SourceSearch(response, prior, stream(request.seed, "source"), counts.in_blocks(_MOST_IN_SOURCE))
    search.with_share(1.0)
    search.with_share(search.independent_share())
    belief = search.belief
    place, probability = belief.within(request.radius_m)
    next_xy = None
    if request.next_from is not None:
        wind = None if counts.wind_m_s is None else counts.last(10).wind_m_s
        mean_wind = None if wind is None else wind.mean(axis=0)
        next_xy = SourceSeeker(area, radius_m=request.radius_m).next_place(
            search, place_of(request.next_from, "--next-from"), mean_wind
        )
    return StatedSource(place, belief.spread_m, probability, belief.share, next_xy)


def _inputs(request: CountsRequest) -> tuple[Counts, survey.Grid, survey.SurveyArea | None]:
    """Read counts and area, and lay the grid of the map."""
    refuse_existing([request.out], force=request.force, inputs=[request.counts], own=OWN_FILES)
    counts = Counts.read(request.counts)
    require_counts(counts)
    if request.source == "plume" and counts.wind_m_s is None:
        raise ConfigError(
            f"--source plume needs the wind, and {request.counts} has no columns wind_east_m_s and wind_north_m_s; add them."
        )
    if request.source == "plume" and np.hypot(*counts.wind_m_s.mean(axis=0)) < _LEAST_WIND_M_S:  # type: ignore[union-attr]
        raise InputError(
            f"{request.counts}: the mean wind is below {_LEAST_WIND_M_S:g} m/s, and a plume without wind leads nowhere; check the columns "
            "wind_east_m_s and wind_north_m_s."
        )
    if request.half_life_s is not None and (request.source != "plume" or request.half_life_s <= 0.0):
        raise ConfigError(
            f"--half-life {request.half_life_s:g} was given; it is longer than 0 s, and needs --source plume."
        )
    if request.next_from is not None:
        place_of(request.next_from, "--next-from")
        if request.source == "none":
            raise ConfigError("--next-from seeks a source; add --source radiation or --source plume.")
    if request.limit_per_s is not None and request.limit_per_s <= 0.0:
        raise ConfigError(f"--limit {request.limit_per_s:g} was given; a limit is above 0 counts/s.")
    area = None if request.area is None else survey.SurveyArea.read(request.area, crs=request.crs)
    (west, south), (east, north) = counts.xy.min(axis=0).tolist(), counts.xy.max(axis=0).tolist()
    bounds = (west, south, east, north) if area is None else area.bounds
    if min(bounds[2] - bounds[0], bounds[3] - bounds[1]) < request.grid:
        raise InputError(
            f"{request.counts}: the places span {bounds[2] - bounds[0]:.1f} × {bounds[3] - bounds[1]:.1f} m, less than one cell "
            f"of {request.grid:g} m; name the ground with --area, or choose a smaller --grid."
        )
    grid = survey.Grid.over(bounds, request.grid, request.crs)
    if np.prod(grid.shape) > _MOST_NODES:
        raise InputError(
            f"the map would have {np.prod(grid.shape):,} nodes and {_MOST_NODES:,} are the most; choose a larger --grid than {request.grid:g} m."
        )
    return counts, grid, area
