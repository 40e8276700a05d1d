"""``firnline plan MISSION``: the plan stage of a mission, or the numbers of swaths and stakes that it needs."""

from firnline.cli.planning.request import PlanRequest


def plan_mission(request: PlanRequest) -> None:
    """Run the plan stage of a mission."""
    from firnline.cli.mission_file import print_summary, run_until

    _, run = run_until(request.source, "plan", request)
    print_summary(run, as_json=request.as_json)


def required_swaths(request: PlanRequest) -> None:
    """Print the numbers of swaths and stakes with which the mission's map meets the class."""
    from firnline.cli.planning.foresight import print_options_of
    from firnline.cli.planning.guarantee import limit_of
    from sim.mission.runs import read_mission

    mission = read_mission(request.source, request.settings)
    print_options_of(mission, limit_of(str(request.require)), request.probability, as_json=request.as_json)
