"""Routes of runs: their list, their maps, differences, reports."""

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.server.replies import report_file
from desk.workspace import Workspace
from survey.core.run_folder import RunFolder


def table(request: Request) -> Response:
    """Answer with the runs of the working folder and what they reached."""
    from desk.runs.found import run_row

    return JSONResponse({"runs": [run_row(name, run) for name, run in _runs(request).items()]})


def layer(request: Request) -> Response:
    """Answer with a map of a run."""
    from desk.runs.found import run_named
    from desk.runs.layers import run_layer

    workspace: Workspace = request.app.state.workspace
    run = run_named(_runs(request), request.path_params["run"])
    return JSONResponse(run_layer(run, request.path_params["layer"], workspace.crs))


def difference(request: Request) -> Response:
    """Answer with the map of one run minus that of another one."""
    from desk.runs.found import run_named
    from desk.runs.layers import difference_layer

    workspace: Workspace = request.app.state.workspace
    runs = _runs(request)
    one, other = (run_named(runs, request.path_params[name]) for name in ("run", "other"))
    return JSONResponse(difference_layer(one, other, workspace.crs))


def report(request: Request) -> Response:
    """Answer with a file of the report of a run."""
    from desk.runs.found import run_named

    run = run_named(_runs(request), request.path_params["run"])
    return report_file(run.folder("report") if run.has("report") else None, request.path_params["name"])


def _runs(request: Request) -> dict[str, RunFolder]:
    from desk.runs.found import found_runs

    workspace: Workspace = request.app.state.workspace
    return found_runs(workspace.folder, workspace.opened_run)
