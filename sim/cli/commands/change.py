"""``firnline change``: elevation, volume and mass change between two surveys."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from sim.cli.facts import end_dry_run
from sim.cli.options import DryRun, Json
from sim.cli.outcome import with_exit_codes
from sim.cli.outputs import refuse_existing, with_companions
from sim.cli.request import with_options_of

OUTPUTS = ("change.tif", "change.tif.aux.xml", "change.csv", "change.json", "change.png")
"""Files that the command writes into its folder."""

if TYPE_CHECKING:
    from survey import Dem, Reconstruction
    from survey.scoring.change.results import Change


@dataclass(frozen=True, kw_only=True)
class ChangeRequest:
    """Options of the command."""

    later: Annotated[
        Path,
        typer.Argument(help="Later survey: raster, folder of a reconstruction, or terrain model (.npz)."),
    ]
    earlier: Annotated[Path, typer.Argument(help="Earlier survey, or any elevation raster.")]
    outline: Annotated[
        Path, typer.Option("--outline", help="Polygons over which to compute change (glacier outlines).")
    ]
    stable: Annotated[
        Path | None,
        typer.Option("--stable", help="Ground that did not change; by default all outside the outlines."),
    ] = None
    align: Annotated[
        bool, typer.Option("--align", help="First shift the earlier survey onto the later one.")
    ] = False
    level: Annotated[bool, typer.Option(help="Subtract the mean difference of the unchanged ground.")] = True
    density_kg_m3: Annotated[
        float, typer.Option("--density", help="Density of the gained or lost material [kg/m³].")
    ] = 850.0
    density_std_kg_m3: Annotated[
        float, typer.Option("--density-std", help="Its standard deviation [kg/m³].")
    ] = 60.0
    crs: Annotated[
        str | None,
        typer.Option("--crs", help="CRS of surveys that carry none or a local one (LOCAL_CS)."),
    ] = None
    step_m: Annotated[
        float, typer.Option("--grid", help="Distance between nodes when terrain models are compared [m].")
    ] = 2.0
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for change.tif, .csv, .json, .png.")] = (
        Path("change")
    )
    report: Annotated[
        Path | None, typer.Option("--report", help="Write a report: a folder, or a file .html or .pdf.")
    ] = None
    force: Annotated[bool, typer.Option("--force", help="Replace a change that is there.")] = False
    dry_run: DryRun = False
    as_json: Json = False

    @property
    def inputs(self) -> tuple[Path | None, ...]:
        """Every file that is read."""
        return self.later, self.earlier, self.outline, self.stable

    def check_outputs(self) -> None:
        """Refuse outputs that exist, that are inputs, or a report of an unknown form."""
        inputs = with_companions(self.inputs)
        refuse_existing([self.out], force=self.force, inputs=inputs, own=OUTPUTS)
        if self.report is None:
            return
        from survey.reporting.document.writing import OUTPUTS as REPORT_OUTPUTS
        from survey.reporting.document.writing import check_target

        own = () if check_target(self.report).suffix else REPORT_OUTPUTS
        refuse_existing([self.report], force=self.force, inputs=inputs, own=own)


@with_exit_codes
@with_options_of(ChangeRequest)
def change(request: ChangeRequest) -> None:
    """Compute the change of elevation, volume and mass on the ground, with correlated errors.

    For example:

      firnline change 2026.tif 2024.tif --outline glacier.gpkg

      firnline change 2026.tif srtm.tif --outline glacier.shp --align --density 900 --density-std 20

      firnline change 2026.tif 2024.tif --outline glacier.gpkg --report change.pdf
    """
    import json

    from survey.core.files.replacing import replacing_folder
    from survey.figures.change import change_map
    from survey.figures.style import png_bytes
    from survey.scoring.change.change_files import change_facts, write_change

    request.check_outputs()
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
    from survey import Dem
    from survey.scoring.change.outlines import read_outlines

    writes = [request.out, *([] if request.report is None else [request.report])]
    surveys = {"later": request.later, "earlier": request.earlier}
    if all(source.suffix == ".npz" for source in surveys.values()):
        end_dry_run(writes)
    read = {name: _surface(source, request.crs) for name, source in surveys.items()}
    dems = {name: one if isinstance(one, Dem) else one.mean for name, one in read.items()}
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
    from sim.cli.scoring.output import today
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

    from survey import Dem
    from survey.scoring.change.change import change as compare
    from survey.scoring.change.outlines import read_outlines

    if request.later.suffix == request.earlier.suffix == ".npz":
        return _models_compared(request.later, request.earlier, request.outline, request.step_m)
    new, old = (_surface(source, request.crs) for source in (request.later, request.earlier))
    crs = (new if isinstance(new, Dem) else new.mean).crs
    outlines = read_outlines(request.outline, crs)
    ground = None
    if request.stable is not None:
        ground = shapely.union_all(list(read_outlines(request.stable, crs).values()))
    return compare(new, old, outlines, stable=ground, align=request.align, level=request.level), outlines


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


def _surface(source: Path, crs: str | None) -> "Reconstruction | Dem":
    """Read a map that is no terrain model."""
    from sim.cli.scoring.maps import map_of

    if source.suffix == ".npz":
        from survey.core.errors import InputError

        raise InputError(
            f"{source} is a terrain model and the other survey is none; compare two models, or two maps."
        )
    return map_of(source, crs)


def _print_change(facts: dict[str, Any], out: Path) -> None:
    from survey.core.text import printable

    if facts["shift"] is not None:
        shift = facts["shift"]
        typer.echo(
            f"coordinates shifted by {shift['east_m']:+.3f} m east, {shift['north_m']:+.3f} m north, {shift['up_m']:+.3f} m up"
        )
    for row in facts["volumes"]:
        typer.echo(
            f"{printable(row['name'])}: {_signed(row['volume_change_m3'])} m³, 95 % between "
            f"{_signed(row['volume_low_95_m3'])} and {_signed(row['volume_high_95_m3'])}; {row['mean_change_m']:+.3f} m on the mean, "
            f"{row['specific_mass_balance_m_we']:+.3f} ± {row['specific_std_m_we']:.3f} m w.e."
        )
    for note in facts["notes"]:
        typer.echo(f"note: {note}")
    typer.echo(f"written to {out}")


def _signed(value: float) -> str:
    """Write a number with its sign and four significant digits, with spaces between thousands."""
    from survey.reporting.quantities import MINUS, rounded

    plain = rounded(value).replace("\u202f", " ").replace(MINUS, "-")
    return plain if plain.startswith("-") else f"+{plain}"
