"""Run missions and summarize them."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

import typer

from firnline.actions.interface import RunOptions, end_dry_run, fact_line
from firnline.cli.progress import StageProgress, logged_to
from sim.config.mission import MissionConfig
from sim.mission.runs import open_run, planned_place, read_mission
from sim.mission.stages import run_mission
from survey.core.documents import read_json
from survey.core.errors import InputError
from survey.core.runs.store import STAGES, RunFolder


def run_until(
    mission_file: Path,
    stage: str,
    options: RunOptions,
    *,
    first: str | None = None,
    workers: int | None = None,
) -> tuple[MissionConfig, RunFolder]:
    """Run the stages of a mission that are not done yet, or all from `first` on, up to a stage; a dry run ends here."""
    if options.dry_run:
        print_stages_of(mission_file, options, first=first, until=stage)
    mission = read_mission(mission_file, options.settings)
    run = open_run(mission, options.runs, first=first)
    with logged_to(run.log_file, options.verbose):
        watch = StageProgress(quiet=options.quiet, expected_s=earlier_seconds(run))
        run_mission(mission, run, until=stage, watch=watch, workers=workers)
    return mission, run


def earlier_seconds(run: RunFolder) -> dict[str, float]:
    """Return how long each stage took in other runs of the same mission, the latest that did it [s]."""
    seconds: dict[str, float] = {}
    others = [file for file in run.path.parent.glob("*/manifest.json") if not file.parent.is_symlink()]
    for file in sorted(others, key=lambda file: file.stat().st_mtime):
        if file.parent == run.path:
            continue
        with suppress(InputError):  # damaged runs are refused when they are opened themselves
            stages = RunFolder(file.parent).manifest["stages"]
            seconds |= {name: float(entry["wall_s"]) for name, entry in stages.items() if entry["wall_s"]}
    return seconds


def print_stages_of(
    mission_file: Path,
    options: RunOptions,
    *,
    first: str | None = None,
    until: str = "report",
) -> NoReturn:
    """Check a mission and its input, print where it would run and which stages are to be done, and end the command."""
    mission = read_mission(mission_file, options.settings)
    place = planned_place(mission, options.runs)
    done = set()
    if (place / "manifest.json").exists() and first != "plan":
        run = RunFolder(place)
        done = {stage for stage in STAGES if run.has(stage)}
    if first is not None:
        done -= set(STAGES[STAGES.index(first) :])
    stages = STAGES[: STAGES.index(until) + 1]
    facts = {
        "run": f"{place}{'' if place.exists() else ' (new)'}",
        "done": ", ".join(stage for stage in stages if stage in done) or "nothing",
        "to do": ", ".join(stage for stage in stages if stage not in done) or "nothing",
    }
    end_dry_run([place], facts)


def summary(run: RunFolder) -> dict[str, Any]:
    """Return folder and stage times of a run, and its score where there is one."""
    stages = {name: entry["wall_s"] for name, entry in run.manifest["stages"].items()}
    content: dict[str, Any] = {"run": str(run.path), "stage_wall_s": stages}
    if run.has("simulate"):
        content |= _driven(run.folder("simulate"))
    if run.has("reconstruct"):
        content["own_claim"] = _own_claim(run.folder("reconstruct"))
    if run.has("score"):
        content["score"] = read_json(run.folder("score") / "score.json", "the score")
    if run.has("report"):
        content["report"] = str(run.folder("report") / "index.html")
    return content


def _driven(folder: Path) -> dict[str, Any]:
    """Return how the drive ended, or that of each rover of a fleet, and what losses cost."""
    from sim.mission.drives import DRIVE_FILE
    from sim.mission.fleet import LOSS_FILE, accounts, drive_folders

    if drive_folders(folder) != [folder]:
        content: dict[str, Any] = {"drives": accounts(folder)}
        losses = folder / LOSS_FILE
        return content | ({"losses": read_json(losses, "the losses")} if losses.exists() else {})
    if not (folder / DRIVE_FILE).exists():
        return {}
    return {"drive": read_json(folder / DRIVE_FILE, "the account of the drive")}


def _own_claim(folder: Path) -> list[str]:
    """Return what the map states of itself: the check by points left out, and its classes."""
    from survey.reconstruction.base import ELEVATION, Reconstruction
    from survey.scoring.standards.certificate import own_claim

    result = Reconstruction.read(folder)
    return own_claim(result) if result.quantity == ELEVATION else []


def print_summary(run: RunFolder, *, as_json: bool) -> None:
    """Print the summary, for people or as JSON."""
    content = summary(run)
    if as_json:
        typer.echo(json.dumps(content, indent=2))
        return
    total = sum(seconds or 0.0 for seconds in content["stage_wall_s"].values())
    times = ", ".join(f"{name} {seconds or 0.0:.1f} s" for name, seconds in content["stage_wall_s"].items())
    typer.echo(fact_line("stages", f"{times} (together {total:.1f} s)"))
    _print_drives(content)
    if "score" in content:
        typer.echo(fact_line("RMSE", f"{content['score']['elevation']['rmse_m']:.3f} m"))
        typer.echo(fact_line("class", best_class(content["score"])))
    for sentence in content.get("own_claim", []):
        typer.echo(fact_line("map", sentence))
    end = "report" if "report" in content else "run"
    typer.echo(fact_line(end, content[end]))


def _print_drives(content: dict[str, Any]) -> None:
    """Print how each drive ended, and what the loss of rovers cost."""
    drives = content.get("drives", [content["drive"]] if "drive" in content else [])
    for k, drive in enumerate(drives, 1):
        name = "drive" if len(drives) == 1 else f"rover {k}"
        reached = f"{drive['ending']} after {drive['progress_m']:.0f} of {drive['route_m']:.0f} m"
        typer.echo(fact_line(name, reached))
    if "losses" in content:
        losses = content["losses"]
        n_lost = len(losses["lost"])
        cost = (
            f"{n_lost} rover{'s' * (n_lost > 1)}; swaths not driven {losses['swaths_not_driven_m']:.0f} m, extra way "
            f"{losses['extra_length_m']:.0f} m, extra time {losses['extra_time_s']:.0f} s"
        )
        typer.echo(fact_line("losses", cost))


def best_class(score: dict[str, Any]) -> str:
    """Return a sentence about the strictest row of the standard that a map meets, from the plain values of a score."""
    from survey.scoring.standards.map_classes import uncovered_sentence
    from survey.scoring.standards.standards import LEAST_COVERED

    verdicts: list[dict[str, Any]] = score["verdicts"]
    if score["covered_share"] < LEAST_COVERED:
        return f"{uncovered_sentence(score['covered_share'])} RMSE on the covered part {verdicts[0]['rmse_m']:.3f} m"
    met = [verdict for verdict in verdicts if verdict["met"]]
    row = met[-1] if met else verdicts[0]
    words = "met, RMSE" if met else "not met, not even the loosest row: RMSE"
    return (
        f"{row['map_class']} at a {row['interval_m']:.4g} m interval ({row['standard']}) {words} "
        f"{row['rmse_m']:.3f} m, limit {row['limit_m']:.4f} m"
    )


def class_met(content: dict[str, Any], wanted: str) -> bool:
    """Return whether the map meets the loosest row of the wanted class, ``class-1`` to ``class-3``."""
    verdicts = content.get("score", {}).get("verdicts", [])
    return any(v["met"] for v in verdicts if v["map_class"].lower().replace(" ", "-") == wanted)
