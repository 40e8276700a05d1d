"""Plan and drive a mission: along its route, or in real time as other programs command."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from datetime import UTC, datetime

from threadpoolctl import threadpool_limits

from firnline.actions.interface import Preview, fact_line, needs_live_extra, previewed_by
from firnline.actions.requests import SimulateRequest
from firnline.actions.runs import (
    SERVED_FILE,
    RunResult,
    Watch,
    logged_to,
    preview_stages,
    run_until,
    unwatched,
)
from sim.config.mission import MissionConfig
from sim.mission.runs import open_run, planned_place, read_mission
from sim.mission.stages import run_mission
from sim.world.site import SharedWorld
from survey import ConfigError, Route
from survey.core import write_json


def preview_simulate(request: SimulateRequest) -> Preview:
    """Check a mission and its input, and return where it would run."""
    _refuse_unused(request)
    if request.serve:
        with needs_live_extra():
            from live.foxglove_server import listening_socket
        mission = _served_mission(request)
        listening_socket(request.listen or _LISTEN).close()
        return Preview.of([planned_place(mission, request.runs)], {"listens at": request.listen or _LISTEN})
    return preview_stages(request.mission, request, until="simulate")


@previewed_by(preview_simulate)
def simulate(
    request: SimulateRequest,
    watch: Watch = unwatched,
    *,
    verbose: int | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> RunResult:
    """Plan and drive a mission; with `serve` as other programs command.

    Parameters
    ----------
    request : SimulateRequest
        Mission and settings.
    watch : callable
        As for `run`.
    verbose : int, optional
        As for `run`.
    say : callable
        Called with a sentence when a served drive can be joined.

    Returns
    -------
    RunResult
        The run, with a recording and the truth.

    Raises
    ------
    InputError
        What a stage refuses; an address at which nothing can listen.
    ConfigError
        A served mission without images or with several rovers.
    """
    _refuse_unused(request)
    if request.serve:
        return _serve(request, verbose, say)
    made = run_until(
        request.mission, "simulate", request, workers=request.workers, watch=watch, verbose=verbose
    )
    return replace(made, wanted=None)


_LISTEN = "127.0.0.1:8765"


def _refuse_unused(request: SimulateRequest) -> None:
    """Refuse options of a served drive where none is served."""
    if not request.serve and (request.listen is not None or request.truth):
        raise ConfigError("--listen and --truth are for a served drive; add --serve, or leave them out.")


def _served_mission(request: SimulateRequest) -> MissionConfig:
    """Return a mission to be served, under a name with the time: no two of its drives are the same."""
    mission = read_mission(request.mission, request.settings)
    if mission.fidelity != "vision":
        raise ConfigError(
            f"{request.mission} has the fidelity {mission.fidelity!r}, which takes no images while it drives; add --set fidelity=vision."
        )
    if mission.fleet.rovers > 1:
        raise ConfigError(
            f"{request.mission} has {mission.fleet.rovers} rovers, and one is served; add --set fleet.rovers=1."
        )
    return mission.model_copy(update={"name": f"{mission.name}-served-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"})


def _serve(request: SimulateRequest, verbose: int | None, say: Callable[[str], None]) -> RunResult:
    """Plan a mission, and drive it from its start as clients command until the drive ends or is interrupted."""
    mission = _served_mission(request)
    with needs_live_extra():
        from live.served_drive import ServedDrive
    from sim.mission.drives import simulate_drive

    world = SharedWorld(mission)
    with ServedDrive(mission, request.listen or _LISTEN, truth=request.truth) as served:
        run = open_run(mission, request.runs, world=world)
        with logged_to(run.log_file, verbose), _first_interrupt(served.stop):
            run_mission(mission, run, until="plan", world=world)
            route = Route.read(run.folder("plan") / "route.geojson")
            say(f"{served.url}: the drive begins when a program connects; Ctrl+C ends and writes it")
            with run.stage("simulate") as folder, threadpool_limits(limits=1):
                simulate_drive(world.get(), route, mission.of_rover(0), folder, operator=served)
                report = served.finish()
                write_json(folder / SERVED_FILE, asdict(report))
    return RunResult(run, heading=tuple(fact_line(*line) for line in report.lines()))


@contextmanager
def _first_interrupt(stop: Callable[[], None]) -> Iterator[None]:
    """Call a function at the first interrupt of this program, and interrupt it at the next; in the main thread alone."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop_once(*_: object) -> None:
        signal.signal(signal.SIGINT, before)
        stop()

    before = signal.signal(signal.SIGINT, stop_once)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
