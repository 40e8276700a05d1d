"""Commands that explain firnline: ``doctor``, ``example``, ``schema`` and ``help``."""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer.core import TyperGroup

from firnline.actions.interface import Preview
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Json, SurveyStep, print_result
from survey.core import ConfigError


@with_exit_codes
def doctor(as_json: Json = False) -> None:
    """Check the installation and the machine, and state what will not run.

    Packages, physics engine, memory, disk, threads, fonts, caches, transformation grids. The exit code is 1 where
    something will not run.

    For example:

      firnline doctor
    """
    import json

    from firnline.cli.diagnosis import (
        extra_findings,
        library_findings,
        machine_findings,
        package_findings,
        physics_finding,
    )

    findings = [*package_findings(), physics_finding(), *extra_findings()]
    findings += [*machine_findings(), *library_findings()]
    if as_json:
        rows = [
            {"what": f.what, "found": f.found, "well": f.is_well, "prevents": f.prevents} for f in findings
        ]
        typer.echo(json.dumps(rows, indent=2))
    else:
        for finding in findings:
            typer.echo(f"{'ok  ' if finding.is_well else 'LOOK'}  {finding.what:<24} {finding.found}")
        lost = dict.fromkeys(f.prevents for f in findings if not f.is_well)
        typer.echo(f"will not run: {'; '.join(lost)}" if lost else "both demos will run (make demo)")
    if not all(finding.is_well for finding in findings):
        raise typer.Exit(1)


_HEADINGS = {".toml": "missions and studies", ".py": "tutorials, as script NAME or notebook NAME.ipynb"}


@with_exit_codes
def example(
    name: Annotated[
        str | None, typer.Argument(help="Example to copy, such as short_drive; all are listed without it.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="File to write.  [default: in this folder, named as the example]"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    dry_run: DryRun = False,
) -> None:
    """Copy an example, or list them all: missions, studies, tutorials as scripts and notebooks.

    For example:

      firnline example

      firnline example short_drive

      firnline example dem_to_route.ipynb
    """
    if name is None:
        _list()
    else:
        source = _source(name)
        _copy(source, out or Path(source.name), force=force, dry_run=dry_run)


def _list() -> None:
    """Print the names of all examples with one sentence each."""
    for suffix, heading in _HEADINGS.items():
        typer.echo(f"{heading}:")
        for file in sorted(examples_folder().glob(f"*{suffix}")):
            typer.echo(f"  {file.stem:<18} {_first_sentence(file)}")


def _source(name: str) -> Path:
    """Return the file of an example by its name, with or without its suffix."""
    folder = examples_folder()
    files = [*sorted(folder.glob("*.toml")), *sorted(folder.glob("*.py")), *folder.glob("notebooks/*.ipynb")]
    wanted = name.replace("-", "_")
    for file in files:
        if wanted in (file.name, file.stem):
            return file
    names = dict.fromkeys(file.stem for file in files)
    raise ConfigError(f"there is no example {name!r}; take {', '.join(names)}.")


def examples_folder() -> Path:
    """Return the folder of the examples: in the installed package, else beside it in a checkout."""
    import sim

    package = Path(sim.__file__).parent
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "examples"


def _copy(file: Path, target: Path, *, force: bool, dry_run: bool) -> None:
    from firnline.actions.interface import refuse_existing
    from survey.core.files import replacing

    refuse_existing([target], force=force, inputs=[file])
    if dry_run:
        print_result(Preview.of([target]))
        return
    with replacing(target.resolve()) as draft:
        draft.write_bytes(file.read_bytes())
    typer.echo(f"{target} written; run: {_command(file)} {target}")


def _command(file: Path) -> str:
    """Return the command that runs an example."""
    if file.suffix == ".toml":
        is_study = "trials" in tomllib.loads(file.read_text(encoding="utf-8"))
        return "firnline montecarlo" if is_study else "firnline run"
    return "python" if file.suffix == ".py" else "jupyter lab"


def _first_sentence(file: Path) -> str:
    """Return the first sentence of the comment at the head of a mission, or the title of a tutorial."""
    comment = []
    for line in file.read_text(encoding="utf-8").removeprefix("# %% [markdown]\n").splitlines():
        text = line.lstrip("# ").rstrip()
        if not line.startswith("#") or not text:
            break
        comment.append(text)
    sentence = " ".join(comment)
    for end in (". ", ": "):
        sentence = sentence.split(end, 1)[0]
    return sentence.rstrip(".") + "."


@with_exit_codes
def schema(
    kind: Annotated[
        Literal["mission", "study"], typer.Argument(help="Kind of file: mission, or study (Monte Carlo).")
    ] = "mission",
) -> None:
    """Print the JSON Schema of a kind of file, by which editors complete and check it.

    A line #:schema mission.schema.json at the head of a TOML file, as init writes it, names the schema.

    For example:

      firnline schema mission > mission.schema.json

      firnline schema study > study.schema.json
    """
    import json

    from sim.config.mission import MissionConfig
    from sim.mission.runs import json_schema
    from sim.montecarlo.config import StudyConfig

    model = MissionConfig if kind == "mission" else StudyConfig
    typer.echo(json.dumps(json_schema(model, f"firnline {kind} file"), indent=2, ensure_ascii=False))


_EXIT_CODES = """\
0    done
1    internal fault; the message names how to print the traceback for a report
2    wrong usage of the command line
3    bad input or output: the message names the file and what to do
4    bad configuration: the message names the setting
5    done, but the wanted class was not met
130  interrupted; the same command continues
141  the reader of the output closed it"""


@with_exit_codes
def help_(
    context: typer.Context,
    topic: Annotated[
        str | None, typer.Argument(help="formats, exit-codes, settings, or the name of a command.")
    ] = None,
) -> None:
    """Explain a topic: file formats, exit codes, settings, or a command.

    For example:

      firnline help formats

      firnline help plan
    """
    topics = {"formats": _formats, "exit-codes": lambda: _EXIT_CODES, "settings": _settings}
    wanted = (topic or "").lower().replace("_", "-")
    if topic is None:
        typer.echo(f"topics: {', '.join(topics)}, and the name of every command (firnline --help lists them)")
        return
    if wanted in topics:
        typer.echo(topics[wanted]())
        return
    typer.echo(_command_help(context, wanted))


def _command_help(context: typer.Context, name: str) -> str:
    """Return the help of a command."""
    root = context.find_root()
    commands = root.command.commands if isinstance(root.command, TyperGroup) else {}
    if name not in commands:
        raise ConfigError(
            f"there is no topic or command {name!r}; take formats, exit-codes, settings or one of {', '.join(commands)}."
        )
    command = commands[name]
    with type(context)(command, info_name=name, parent=root) as inner:
        return str(command.get_help(inner))


def _formats() -> str:
    """Return what is read and written, by kind of data."""
    from survey.interchange.route_readers import READERS
    from survey.interchange.route_writers import WRITERS
    from survey.io.file_kinds import RASTER_DRIVERS, VECTOR_SUFFIXES
    from survey.io.point_files import READ_ENDINGS as POINTS
    from survey.io.point_files import WRITERS as POINT_WRITERS

    rows = {
        "elevation rasters, read": ", ".join(RASTER_DRIVERS),
        "elevation rasters, written": ".tif (cloud-optimized GeoTIFF), .asc, .nc, .json (STAC item)",
        "areas, read": ", ".join(VECTOR_SUFFIXES),
        "areas, written": ".geojson, .gpkg, .kml, .shp",
        "routes, read": ", ".join(sorted(READERS)),
        "routes, written": ", ".join(sorted(WRITERS)),
        "plans, written": ".geojson, .gpkg (route), .pdf (sheets), .qgz (QGIS project)",
        "points, read": f"{', '.join(POINTS)}; .xyz without a header, too",
        "points, written": ", ".join(POINT_WRITERS),
        "checkpoints": ".csv, .txt, .tsv (also GNSS exports with , ; tab or blanks, and decimal commas), .gpx, and other formats of points",
        "land cover (score --by)": "rasters of whole numbers; polygons with a column of classes",
        "reports (score, change)": "a folder, .html or .pdf",
        "tracks": ".csv, .tum, .gpx, .gpkg; .txt (KITTI) is written",
        "images and sensors": "folders of images (times in names, EXIF or a list); TUM, EuRoC, KITTI, ROS 1 and ROS 2 bags",
        "fixes (localize --gps)": "NMEA, u-blox .ubx, Android GnssLogger .txt, RTKLIB .pos, .gpx, .csv (usual names, or --columns)",
        "calibrations": "camera.toml (firnline calibrate writes one), YAML of ROS, OpenCV, Kalibr, ORB-SLAM",
        "missions and studies": ".toml (firnline init writes one)",
    }
    lines = [f"{name:<27} {endings}" for name, endings in rows.items()]
    notes = [
        "",
        "Coordinates in degrees are projected to their UTM zone (polar stereographic beyond 84° N and 80° S)",
        "unless --crs or another file names a projected CRS. Heights stay above the datum of their file.",
    ]
    return "\n".join([*lines, *notes])


def _settings() -> str:
    return (
        "firnline init my-survey.toml writes every setting of a mission with meaning, unit and default.\n"
        "--set KEY=VALUE overrides one, as in --set planner.swaths=6 --set rover.speed_m_s=1.5;\n"
        "an unknown key is refused with the nearest known one."
    )


COMMANDS = {SurveyStep.EXPLAIN: (doctor, example, schema)}
"""Commands by the step of a survey that they belong to."""
