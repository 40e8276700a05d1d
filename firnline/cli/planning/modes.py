"""Modes of ``firnline plan``: which function carries out a request, and which options contradict it."""

from collections.abc import Callable

from firnline.cli.planning.request import PlanRequest

_OF_A_MISSION = (
    "swaths",
    "spacing",
    "budget",
    "rmse",
    "prior",
    "crs",
    "no_go",
    "rovers",
    "max_slope",
    "pattern",
)
_OF_AN_AREA = ("joint", "adaptive", "driven", "measured", "assume", "force", "season", "dates")
_DECIDED = ("pattern", "swaths", "spacing", "budget", "rmse", "rovers", "max_slope")


def mode_of(request: PlanRequest) -> Callable[[PlanRequest], None]:
    """Return the function that carries out a request."""
    if request.require is not None:
        from planners.guarantee.requirement import require_probability

        require_probability(request.probability)
    if request.is_mission:
        return _mission_mode(request)
    if request.given("season", "dates"):
        mode = _season_mode(request)
        request.check_outputs()
        return mode
    if request.require is None:
        from survey.core.errors import ConfigError

        stated = request.given("joint", "adaptive", "driven", "measured", "assume")
        if stated:
            raise ConfigError(
                f"{', '.join(stated)} goes with --require; give the class or error that is required."
            )
    mode = _area_mode() if request.require is None else _guarantee_mode(request)
    request.check_outputs()
    return mode


def _area_mode() -> Callable[[PlanRequest], None]:
    from firnline.cli.planning.area import plan_area

    return plan_area


def _mission_mode(request: PlanRequest) -> Callable[[PlanRequest], None]:
    """Return what to do with a mission file; options that the file decides are refused."""
    from survey.core.errors import ConfigError

    stated = request.given(*_OF_A_MISSION)
    if stated:
        raise ConfigError(
            f"{request.source} is a mission file, which sets {', '.join(stated)} itself; change it with --set, "
            "as in --set planner.swaths=6."
        )
    foreign = request.given(*_OF_AN_AREA)
    if foreign:
        raise ConfigError(
            f"{', '.join(foreign)} goes with an area, but {request.source} is a mission file; leave it out."
        )
    from firnline.cli.planning.mission import plan_mission, required_swaths

    return plan_mission if request.require is None else required_swaths


def _season_mode(request: PlanRequest) -> Callable[[PlanRequest], None]:
    """Return the function for a season; options that contradict it are refused."""
    from survey.core.errors import ConfigError

    if request.season is None or request.dates is None:
        raise ConfigError(
            "--season and --dates belong together: the wanted error, and the days of both surveys."
        )
    stated = request.given(*_DECIDED, "require", "joint", "adaptive", "assume", "settings")
    if stated:
        raise ConfigError(f"--season chooses swaths, stakes and days itself; leave out {', '.join(stated)}.")
    if request.out.suffix.lower() not in (".geojson", ".gpkg"):
        raise ConfigError(f"--season writes a route (.geojson, .gpkg), not {request.out}; choose another -o.")
    from firnline.cli.planning.season import plan_season

    return plan_season


def _guarantee_mode(request: PlanRequest) -> Callable[[PlanRequest], None]:
    """Return the function for a required class; options that contradict it are refused."""
    from survey.core.errors import ConfigError

    stated = [
        name for name in request.given(*_DECIDED) if name != "--pattern" or request.pattern != "lawnmower"
    ]
    if request.settings and not request.joint:
        stated.append("--set (which goes with --joint)")
    if stated:
        raise ConfigError(
            f"--require chooses pattern, swaths and spacing itself, for one rover; leave out {', '.join(stated)}."
        )
    if request.joint and request.adaptive:
        raise ConfigError("--joint predicts a complete survey beforehand; leave out --adaptive.")
    return _guaranteed(request)


def _guaranteed(request: PlanRequest) -> Callable[[PlanRequest], None]:
    """Import and return the function for a required class."""
    if request.joint:
        from firnline.cli.planning.foresight import plan_joint

        return plan_joint
    if request.adaptive:
        from firnline.cli.planning.adaptive import plan_adaptive

        return plan_adaptive
    from firnline.cli.planning.guarantee import plan_guaranteed

    return plan_guaranteed
