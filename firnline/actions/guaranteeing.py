"""Plans that guarantee a map class: before the survey, swath by swath, or of the map that a LiDAR makes between the swaths."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import planners
import survey
from firnline.actions.interface import NotMetError, Progress, fact_line, no_progress
from firnline.actions.plan_request import PlanDrawing, PlanRequest, PlanResult
from firnline.actions.plan_texts import level_text
from survey.core import ConfigError, InputError, length_text

if TYPE_CHECKING:
    from planners.guarantee.adaptive import AdaptiveSurvey
    from planners.guarantee.guarantee import Guarantee
    from planners.guarantee.requirement import MapRequirement
    from planners.swaths.lidar_spacing import LidarSpacing


def limit_of(require: str) -> float:
    """Return the widest limit of a class of the paper's tables [m], or the number of metres that was given."""
    from survey.scoring.standards.map_classes import map_classes

    widest = {row.map_class.lower().replace(" ", "-"): row.limit_m for row in reversed(map_classes())}
    if require in widest:
        return widest[require]
    try:
        return float(require)
    except ValueError as error:
        raise ConfigError(
            f"--require {require} is no map class; take {', '.join(sorted(widest))} or an error in metres."
        ) from error


def requirement_of(request: PlanRequest) -> "MapRequirement":
    """Return what the map has to meet."""
    from planners.guarantee.requirement import MapRequirement

    return MapRequirement(
        limit_of(str(request.require)),
        request.probability,
        max_swaths=request.max_swaths,
        **vars(request.assumptions),
    )


def prior_of(request: PlanRequest) -> "tuple[survey.SurveyArea, survey.Dem]":
    """Read the area and the prior that a guarantee needs."""
    if request.prior is None:
        raise InputError("a guarantee needs the roughness of the terrain; give a coarse DEM with --prior.")
    area, prior = request.read_area()
    return area, cast("survey.Dem", prior)


def found_guarantee(
    area: "survey.SurveyArea", prior: "survey.Dem", requirement: "MapRequirement", progress: Progress
) -> "Guarantee":
    """Return the guarantee; refuse where it does not hold, with what can be reached as notes of the exception."""
    from planners.guarantee.guarantee import guarantee

    progress("fitting the terrain's covariance", 0, 1)
    made = guarantee(area, prior, requirement, progress=progress)
    if not made.holds:
        refusal = NotMetError(refusal_text(made))
        for line in reachable_lines(made):
            refusal.add_note(line)
        raise refusal
    return made


def refusal_text(made: "Guarantee") -> str:
    """Return why a guarantee does not hold, and what can be done, in one sentence."""
    from planners.guarantee.survey_lines import LONGEST_M
    from survey.scoring.standards.map_classes import edition_2_class

    requirement = made.requirement
    reason = f" {contradiction_text(made)}; " if made.is_contradicted else " "
    if made.predicted.probability >= requirement.probability:
        return (
            f"an RMSE of {requirement.limit_m:.4g} m cannot be guaranteed: {made.config.swaths} swaths are predicted "
            f"to reach it with {made.predicted.probability:.0%}, but {len(made.simulated.rmse_m)} simulated surveys of other "
            f"ground do in {made.simulated_share:.0%}, which shows {made.simulated_bound:.0%} at least ({_shares(made)});"
            f"{reason}--adaptive learns how rough the ground is from its first swaths."
        )
    is_longest = made.length_m > LONGEST_M and requirement.max_swaths is None
    longest = (
        f", more than {length_text(LONGEST_M)} to drive are tried with --max-swaths alone"
        if is_longest
        else ""
    )
    return (
        f"an RMSE of {requirement.limit_m:.4g} m cannot be guaranteed with {requirement.probability:.0%} by up to "
        f"{made.config.swaths} swaths{longest}; with that probability they reach {made.reachable_m:.3g} m, "
        f"the {edition_2_class(made.reachable_m)} by ASPRS Edition 2;{reason}--swaths {made.config.swaths} --pattern "
        f"{made.config.pattern} instead of --require plans the densest, and --adaptive learns how rough the ground is from its first "
        "swaths."
    )


def reachable_lines(made: "Guarantee") -> list[str]:
    """Return what a refused guarantee assumes, what numbers of swaths are predicted to reach, and the level of the densest's map."""
    return [
        fact_line("assumed", made.assumptions),
        *_option_lines(made),
        fact_line("level of the map", _level_of(made)),
    ]


def _option_lines(made: "Guarantee") -> list[str]:
    return [fact_line("predicted are" if k == 0 else "", str(one)) for k, one in enumerate(made.options)]


def _level_of(made: "Guarantee") -> str:
    """Return how much of the map's error its level is, and what known heights change."""
    own = next(one for one in made.options if one.swaths == made.config.swaths)
    levels = {name: one.rmse_m for name, one in own.by_level.items()}
    return level_text(made.requirement.shared_m, made.level_m, own.prior_level_share, levels)


def contradiction_text(made: "Guarantee") -> str:
    """Return by how much the relief of the prior contradicts the stated class of surface."""
    without = "" if made.unstated_m is None else f", where the densest survey reaches {made.unstated_m:.3g} m"
    return (
        f"the relief of the prior contradicts surface {made.requirement.surface}: repeated at a smaller scale it gives "
        f"{made.resampled_ratio:.1f} times the error predicted for that class; leave --surface out{without}"
    )


def _shares(made: "Guarantee") -> str:
    """Return the share of simulated surveys that met the limit, by kind of ground."""
    limit_m = made.requirement.limit_m
    names = dict.fromkeys(made.simulated.grounds)
    return ", ".join(f"{name} {made.simulated.share(limit_m, name):.0%}" for name in names)


@dataclass(frozen=True, kw_only=True)
class GuaranteedPlan(PlanResult):
    """Shortest route that guarantees a class.

    `guarantee`: the guarantee, and what it rests on.
    """

    guarantee: "Guarantee"

    def facts(self) -> dict[str, Any]:
        """Return files, pattern, probabilities and assumptions."""
        made = self.guarantee
        limit_m = made.requirement.limit_m
        return {
            **self.request.written,
            "pattern": made.config.pattern,
            "lines": made.route.n_lines,
            "swaths": len(made.route.swaths),
            "length_m": made.length_m,
            "limit_m": limit_m,
            "probability": made.predicted.probability,
            "rmse_m": made.predicted.rmse_m,
            "likely_rmse_m": made.likely.rmse_m,
            "likely_swaths": made.likely_swaths,
            "simulated_share": made.simulated_share,
            "simulated_bound": made.simulated_bound,
            "simulated_shares": {
                name: made.simulated.share(limit_m, name) for name in dict.fromkeys(made.simulated.grounds)
            },
            "options": [one.facts() for one in made.options],
            "prior_level_m": made.level_m,
            "stakes": None if made.stakes is None else str(made.stakes),
            "assumed": made.assumptions,
        } | {
            name: value
            for name, value in made.route.prediction.items()
            if name in ("map_scale", "prior_covered_share")
        }

    def lines(self) -> list[str]:
        """Return the pattern and the guarantee, and what it rests on."""
        from planners.swaths.reference_lines import swaths_text

        made = self.guarantee
        requirement = made.requirement
        facts = {
            "assumed": made.assumptions,
            "predicted": f"RMSE {made.predicted.rmse_m:.2f} m, within the limit with {made.predicted.probability:.0%}; in "
            f"{made.simulated_share:.0%} of {len(made.simulated.rmse_m)} simulated surveys of other ground "
            f"({_shares(made)}), which shows {made.simulated_bound:.0%} at least",
        }
        if made.is_contradicted:
            facts["but"] = contradiction_text(made)
        if made.likely_swaths < (made.config.swaths or 0):
            facts["likeliest ground"] = (
                f"RMSE {made.likely.rmse_m:.2f} m, and {made.likely_swaths} swaths are enough; --adaptive finds out"
            )
        if made.stakes is not None:
            facts["or"] = str(made.stakes)
        facts["level of the map"] = _level_of(made)
        facts["not included"] = "errors of position that grow along the path (--joint predicts them)"
        facts["written to"] = self.request.written_text
        first = (
            f"{made.config.pattern} pattern, {swaths_text(made.route)}, {length_text(made.length_m)} to drive: an RMSE within "
            f"{requirement.limit_m:.4g} m is guaranteed with {requirement.probability:.0%}."
        )
        return [first, *(fact_line(name, text) for name, text in facts.items()), *_option_lines(made)]


def plan_guaranteed(request: PlanRequest, progress: Progress = no_progress) -> GuaranteedPlan:
    """Plan the shortest route that guarantees the class."""
    requirement = requirement_of(request)
    area, prior = prior_of(request)
    made = found_guarantee(area, prior, requirement, progress)
    drawing = PlanDrawing(area, prior, planners.prior_model(prior, area, request.assumptions))
    return GuaranteedPlan(request=request, route=made.route, drawing=drawing, guarantee=made)


_TEXTS: dict[str, Callable[[Any], str]] = {
    "length_m": length_text,
    "probability": "{:.0%}".format,
    "rmse_m": "{:.2f} m".format,
}
"""Facts that people read in other units than machines."""


@dataclass(frozen=True, kw_only=True)
class AdaptivePlan(PlanResult):
    """First swaths of a survey, or the next one; without a route the guarantee holds already.

    `stated`: facts about them.
    """

    stated: Mapping[str, Any]

    def facts(self) -> dict[str, Any]:
        """Return files, length and the stated facts."""
        if self.route is None:
            return dict(self.stated)
        return {**self.request.written, "length_m": self.route.ground_length_m, **self.stated}

    def lines(self) -> list[str]:
        """Return the facts with their units."""
        return [
            fact_line(name.removesuffix("_m").replace("rmse", "predicted RMSE"), _TEXTS.get(name, str)(value))
            for name, value in self.facts().items()
        ]


def plan_adaptive(request: PlanRequest, progress: Progress = no_progress) -> AdaptivePlan:
    """Plan the first swaths, or the next one after what was driven and measured."""
    if (request.driven is None) != (request.measured is None):
        raise ConfigError("--driven and --measured belong together: the route so far, and its samples.")
    if request.assume is not None:
        raise ConfigError("--adaptive fits the covariance to the survey; leave out --assume.")
    requirement = requirement_of(request)
    area, prior = prior_of(request)
    progress("fitting the terrain's covariance", 0, 1)
    if request.driven is not None and request.measured is not None:
        return _plan_next(request, request.driven, request.measured, area, prior)
    return _plan_first(request, area, prior, requirement)


def swath_advice(
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    driven: "survey.Route",
    points: "survey.SurfacePoints",
    requirement: "MapRequirement",
) -> "AdaptiveSurvey":
    """Return the swath to drive next after what was driven and measured, or that none is needed or none would help."""
    from planners.guarantee.adaptive import AdaptiveConfig, next_swath

    config = AdaptiveConfig.of_prior(requirement, area, prior)
    return next_swath(area, driven, points.xy, points.xyz[:, 2], config)


def _plan_first(
    request: PlanRequest, area: "survey.SurveyArea", prior: "survey.Dem", requirement: "MapRequirement"
) -> AdaptivePlan:
    """Plan the first swaths."""
    from planners.guarantee.adaptive import AdaptiveConfig, first_swaths
    from planners.guarantee.guarantee import posterior_of

    config = AdaptiveConfig.of_prior(requirement, area, prior)
    route = first_swaths(area, posterior_of(area, prior, requirement), config)
    step = "drive and measure them, then run this again with --driven and --measured"
    stated = {"swaths": len(route.swaths), "next": step}
    return AdaptivePlan(request=request, route=route, drawing=PlanDrawing(area, prior), stated=stated)


def _plan_next(
    request: PlanRequest, driven: Path, measured: Path, area: "survey.SurveyArea", prior: "survey.Dem"
) -> AdaptivePlan:
    """Plan the next swath, find that none is needed, or refuse where none would help."""
    points = survey.SurfacePoints.read(measured, crs=area.crs.to_wkt())
    requirement = requirement_of(request)
    advice = swath_advice(area, prior, survey.Route.read(driven), points, requirement)
    if not advice.holds:
        raise NotMetError(
            f"no further swaths would reach {requirement.limit_m:.4g} m with {requirement.probability:.0%}; "
            f"the densest survey is predicted to err {advice.predicted.rmse_m:.3g} m."
        )
    predicted = advice.predicted
    stated: dict[str, Any] = {"probability": predicted.probability, "rmse_m": predicted.rmse_m}
    if advice.route is None:
        stated = {"done": "the guarantee holds, no more driving is needed", **stated}
    return AdaptivePlan(request=request, route=advice.route, drawing=PlanDrawing(area, prior), stated=stated)


@dataclass(frozen=True, kw_only=True)
class LidarPlan(PlanResult):
    """Route whose swaths are as far apart as the map of a LiDAR's scans allows.

    `spacing`: the widest distance between swaths with its prediction. `limit_m`: largest RMSE [m].
    """

    route: "survey.Route"
    spacing: "LidarSpacing"
    limit_m: float

    def facts(self) -> dict[str, Any]:
        """Return files, spacing and predictions."""
        sizes = {"limit_m": self.limit_m, "spacing_m": self.route.spacing_m, "swaths": len(self.route.swaths)}
        return self.request.written | sizes | dict(self.route.prediction)

    def lines(self) -> list[str]:
        """Return the spacing, and what is predicted of the map."""
        from planners.swaths.reference_lines import swaths_text

        found = self.spacing
        rows = {
            "length": length_text(self.route.prediction["length_m"]),
            "widest spacing": f"{found.spacing_m:.3g} m, RMSE of the LiDAR's map up to {found.rmse_m:.2g} m with {self.request.probability:.0%}",
            "one swath": f"maps the ground within {self.limit_m:.3g} m as far as {found.range_m:.3g} m beside it",
            "EMap paper": f"two swaths for a width of 3 r_m = {found.paper_width_m:.3g} m",
            "not included": "errors of the path",
        }
        swaths = f"{swaths_text(self.route)}, written to {self.request.written_text}"
        return [swaths, *(fact_line(title, text) for title, text in rows.items())]


def plan_lidar(request: PlanRequest, progress: Progress = no_progress) -> LidarPlan:
    """Plan swaths that are as far apart as the map of a mission's LiDAR allows."""
    from planners.swaths.lidar_spacing import widest_spacing
    from sim.mission.foresight import lidar_survey
    from sim.mission.runs import read_mission

    mission = read_mission(cast("Path", request.lidar), request.settings)
    area, prior = prior_of(request)
    limit_m = limit_of(str(request.require))
    found = widest_spacing(
        area,
        prior,
        lidar_survey(mission),
        limit_m,
        probability=request.probability,
        assumed=request.assumptions,
        progress=progress,
    )
    if found.rmse_m > limit_m:
        raise NotMetError(
            f"no distance between swaths is predicted to map the area within {limit_m:.4g} m with {request.probability:.0%}: "
            f"{found.spacing_m:g} m apart the RMSE is {found.rmse_m:.2g} m; ask for a larger error, state the ground "
            "(--surface, --micro-relief) or a better prior, or give the mission a higher scanner, more beams or a finer map."
        )
    route = planners.plan(
        area, prior, planners.LawnmowerConfig(spacing_m=found.spacing_m), rover=mission.rover
    )
    predicted = {f"lidar_{name}": value for name, value in found._asdict().items()}
    route = replace(route, prediction={**route.prediction, **predicted})
    drawing = PlanDrawing(area, prior, rover=mission.rover)
    return LidarPlan(request=request, route=route, drawing=drawing, spacing=found, limit_m=limit_m)
