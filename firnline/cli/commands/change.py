"""Commands of two surveys: ``change`` and ``track``."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from firnline.actions.changes import OUTPUTS, ChangeRequest
from firnline.actions.interface import DryRun, Quiet, end_dry_run
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from survey import Dem, Reconstruction
    from survey.scoring.change.along_flow import Thickness
    from survey.scoring.change.results import Change
    from survey.scoring.motion.displacements import DisplacementField
    from survey.scoring.motion.tracking import TrackedMotion


@with_exit_codes
@with_options_of(ChangeRequest)
def change(request: ChangeRequest) -> None:
    """Compute the change of elevation, volume and mass on the ground, with correlated errors.

    For example:

      firnline change 2026.tif 2024.tif --outline glacier.gpkg

      firnline change 2026.tif srtm.tif --outline glacier.shp --align --density 900 --density-std 20

      firnline change 2026.tif 2024.tif --outline glacier.gpkg --report change.pdf

      firnline change 2026.tif 2024.tif --outline glacier.gpkg --flow track --thickness 80
    """
    import json

    from survey.core.files.replacing import replacing_folder
    from survey.figures.change import change_map
    from survey.figures.style import png_bytes
    from survey.scoring.change.change_files import change_facts, write_change

    request.check()
    if request.dry_run:
        _end_dry_run(request)
    found, outlines = _compared(request)
    density = request.density_kg_m3, request.density_std_kg_m3
    facts = change_facts(found, *density)
    with replacing_folder(request.out, own=OUTPUTS) as draft:
        write_change(draft, found, *density)
        (draft / "change.png").write_bytes(png_bytes(change_map(found, outlines)))
    if request.report is not None:
        _write_report(request.report, request.inputs, found, outlines, facts)
    if request.as_json:
        typer.echo(json.dumps(facts, indent=2))
        return
    _print_change(facts, request.out)
    if request.report is not None:
        typer.echo(f"report written to {request.report}")


def _end_dry_run(request: ChangeRequest) -> NoReturn:
    """Read surveys and outlines, and print what would be compared."""
    from firnline.actions.changes import surveys_of
    from survey import Dem
    from survey.scoring.change.outlines import read_outlines

    writes = [request.out, *([] if request.report is None else [request.report])]
    surveys = {"later": request.later, "earlier": request.earlier}
    if all(source.suffix == ".npz" for source in surveys.values()):
        end_dry_run(writes)
    *read, _ = surveys_of(request.later, request.earlier, request.crs)
    dems = dict(zip(surveys, (one if isinstance(one, Dem) else one.mean for one in read), strict=True))
    facts = {name: "{} × {} cells".format(*dem.shape) for name, dem in dems.items()}
    outlines = read_outlines(request.outline, dems["later"].crs)
    end_dry_run(writes, {**facts, "outlines": ", ".join(outlines)})


def _write_report(
    report: Path,
    inputs: tuple[Path | None, ...],
    found: "Change",
    outlines: dict[str, Any],
    facts: dict[str, Any],
) -> None:
    from firnline.actions.scoring import today
    from survey.reporting.accuracy.change import change_report
    from survey.reporting.accuracy.parts import ReportSetting
    from survey.reporting.document import write_document

    roles = ("Later survey", "Earlier survey", "Outlines", "Unchanged ground from")
    names = {role: path.name for role, path in zip(roles, inputs, strict=True) if path is not None}
    title = f"{names['Later survey']} minus {names['Earlier survey']}"
    write_document(report, change_report(ReportSetting(title, today(), names), found, outlines, facts))


def _compared(request: ChangeRequest) -> tuple["Change", dict[str, Any]]:
    """Compare two terrain models by their posteriors, anything else by the unchanged ground."""
    import shapely

    from firnline.actions.changes import surveys_of
    from survey import Dem
    from survey.scoring.change.change import change as compare
    from survey.scoring.change.outlines import read_outlines

    if request.later.suffix == request.earlier.suffix == ".npz":
        return _models_compared(request.later, request.earlier, request.outline, request.step_m)
    new, old, note = surveys_of(request.later, request.earlier, request.crs)
    crs = (new if isinstance(new, Dem) else new.mean).crs
    outlines = read_outlines(request.outline, crs)
    ground = None
    if request.stable is not None:
        ground = shapely.union_all(list(read_outlines(request.stable, crs).values()))
    flow, thickness = _flow(request, new, old)
    found = compare(
        new,
        old,
        outlines,
        stable=ground,
        align=request.align,
        level=request.level,
        flow=flow,
        thickness=thickness,
    )
    return replace(found, notes=(*found.notes, *note)), outlines


def _flow(
    request: ChangeRequest, new: "Reconstruction | Dem", old: "Reconstruction | Dem"
) -> "tuple[DisplacementField | None, Thickness | None]":
    """Return the flow between the surveys and the thickness of the ice, where they are named."""
    from firnline.actions.changes import flow_of, thickness_of
    from survey import Dem

    if request.flow is None:
        return None, None
    later, earlier = (one if isinstance(one, Dem) else one.mean for one in (new, old))
    thickness = thickness_of(request.thickness, request.thickness_error)
    return flow_of(request.flow, request.days, later, earlier), thickness


def _models_compared(
    later: Path, earlier: Path, outline: Path, step_m: float
) -> tuple["Change", dict[str, Any]]:
    import shapely

    from survey import Grid
    from survey.core.errors import InputError
    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
    from survey.scoring.change.models import change_of_models
    from survey.scoring.change.outlines import read_outlines

    new, old = GaussianProcessTerrain.load(later), GaussianProcessTerrain.load(earlier)
    crs = getattr(new.prior, "crs", None) or getattr(old.prior, "crs", None)
    if crs is None:
        raise InputError(
            f"{later} and {earlier} carry no coordinate reference system (models built on a raster do); "
            "compare their maps instead."
        )
    outlines = read_outlines(outline, crs)
    bounds = shapely.union_all(list(outlines.values())).bounds
    return change_of_models(new, old, outlines, Grid.over(bounds, step_m, crs)), outlines


def _print_change(facts: dict[str, Any], out: Path) -> None:
    from survey.core.text import printable

    if facts["shift"] is not None:
        shift = facts["shift"]
        typer.echo(
            f"coordinates shifted by {shift['east_m']:+.3f} m east, {shift['north_m']:+.3f} m north, {shift['up_m']:+.3f} m up"
        )
    if facts["offset_m"]:
        typer.echo(
            f"{facts['offset_m']:+.3f} m subtracted, the mean difference of the unchanged ground (--no-level does not)"
        )
    for row in facts["volumes"]:
        typer.echo(
            f"{printable(row['name'])}: {_signed(row['volume_change_m3'])} m³, 95 % between "
            f"{_signed(row['volume_low_95_m3'])} and {_signed(row['volume_high_95_m3'])}; {row['mean_change_m']:+.3f} m on the mean, "
            f"{row['specific_mass_balance_m_we']:+.3f} ± {row['specific_std_m_we']:.3f} m w.e."
        )
    for row in facts.get("along_flow", ()):
        typer.echo(_flow_line(row))
    for note in facts["notes"]:
        typer.echo(f"note: {note}")
    typer.echo(f"written to {out}")


def _flow_line(row: dict[str, Any]) -> str:
    """Return the change along the flow and the balance of one outline as a sentence."""
    from survey.core.text import printable

    return (
        f"{printable(row['name'])}: along the flow {row['along_mean_m']:+.3f} ± {row['along_std_m']:.3f} m; the flow carried off "
        f"{row['flux_divergence_m']:+.3f} ± {row['flux_divergence_std_m']:.3f} m of ice (thickness {row['thickness_m']:.0f} m), "
        f"gained at surface and bed {row['balance_m']:+.3f} ± {row['balance_std_m']:.3f} m of ice"
    )


def _signed(value: float) -> str:
    """Write a number with its sign and four significant digits, with spaces between thousands."""
    from survey.reporting.quantities import MINUS, rounded

    plain = rounded(value).replace("\u202f", " ").replace(MINUS, "-")
    return plain if plain.startswith("-") else f"+{plain}"


@dataclass(frozen=True, kw_only=True)
class TrackRequest:
    """Options of the command."""

    earlier: Annotated[Path, typer.Argument(help="Earlier survey: a raster of elevations, or an orthoimage.")]
    later: Annotated[Path, typer.Argument(help="Later survey on the same grid.")]
    days: Annotated[float, typer.Option("--days", min=1e-6, help="Time between the surveys [days].")]
    images: Annotated[
        bool, typer.Option("--images", help="Match the rasters as images, not hillshades of elevations.")
    ] = False
    window_px: Annotated[int, typer.Option("--window", help="Width of the windows, odd [pixels].")] = 33
    step_px: Annotated[int, typer.Option("--step", min=1, help="Distance of the windows [pixels].")] = 16
    search_px: Annotated[int, typer.Option("--search", help="Largest displacement searched [pixels].")] = 24
    out: Annotated[Path, typer.Option("--out", "-o", help="Points: .gpkg, .geojson or .shp.")] = Path(
        "velocity.gpkg"
    )
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False
    dry_run: DryRun = False
    quiet: Quiet = False


@with_exit_codes
@with_options_of(TrackRequest)
def track(request: TrackRequest) -> None:
    """Track the features of a moving surface between two surveys: displacements, velocities and their errors.

    Weak matches, and those that contradict their neighbours, are written with outlier = 1.

    For example:

      firnline track 2024.tif 2026.tif --days 730 -o velocity.gpkg
    """
    from firnline.actions.files import refuse_existing
    from survey.core.map_scale import MapScale
    from survey.data.dem import Dem
    from survey.scoring.motion.tracked_file import write_tracked
    from survey.scoring.motion.tracking import check_pair, track

    refuse_existing([request.out], force=request.force, inputs=(request.earlier, request.later))
    earlier, later = Dem.read(request.earlier), Dem.read(request.later)
    check_pair(earlier, later, request.window_px, request.search_px)
    if request.dry_run:
        end_dry_run([request.out], {"surveys": "{} × {} cells".format(*earlier.shape)})
    found = track(
        earlier,
        later,
        window_px=request.window_px,
        step_px=request.step_px,
        search_px=request.search_px,
        shaded=not request.images,
    )
    write_tracked(request.out, found, request.days, earlier.crs)
    if not request.quiet:
        scale = MapScale.over(earlier.crs, earlier.bounds).notable_factor
        typer.echo(_speed_text(found, request.days * scale))
        if scale != 1.0:
            typer.echo(
                f"note: {request.out.name} has displacements in metres of {earlier.crs.name}, {scale:.3f} of which are one metre on "
                "the ground here; the speed above is on the ground"
            )


def _speed_text(found: "TrackedMotion", metres: float) -> str:
    """Return the number of windows, the median speed and its error; `metres` of the CRS are one metre a day."""
    import numpy as np

    good = ~found.is_outlier
    if not good.any():
        return f"all {len(found)} windows are outliers; take larger windows, a wider search or surveys closer in time."
    speed = np.hypot(*found.shift_m[good].T) / metres
    sigma = np.hypot(*found.sigma_m[good].T) / np.sqrt(2.0) / metres
    return (
        f"{len(found)} windows, {int((~good).sum())} of them outliers; median speed {np.median(speed):.3g} m a day, "
        f"median standard deviation {np.median(sigma):.2g} m a day on either axis"
    )
