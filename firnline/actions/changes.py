"""Compare two surveys: change of elevation, volume and mass, also along the flow of the ice."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import survey
from firnline.actions.interface import (
    Argument,
    Option,
    Preview,
    WrittenResult,
    previewed_by,
    refuse_existing,
    with_companions,
)
from firnline.actions.requests import Details, Lengths, PictureOptions, Select, stated_details
from firnline.actions.score_request import map_of, today, with_datum
from firnline.actions.tracking import flow_between
from survey.core import ConfigError, picture_files, printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from survey.scoring.differencing.volume_change import Change


OUTPUTS = (
    "along_flow.tif", "along_flow.tif.aux.xml", "change.tif", "change.tif.aux.xml", "change.csv",
    "change.gpkg", "change.json", *picture_files("change"), "change_bands.csv",
)  # fmt: skip
"""Files that the command writes into its folder."""
# From fresh snow to rock debris.
_DENSITIES_KG_M3 = (50.0, 3000.0)


@dataclass(frozen=True, kw_only=True)
class ChangeRequest(PictureOptions):
    """Two surveys to compare."""

    later: Annotated[
        Path, Argument(help="Later survey: raster, folder of a reconstruction, or terrain model (.npz).")
    ]
    earlier: Annotated[Path, Argument(help="Earlier survey, or any elevation raster.")]
    outline: Annotated[
        Path | None,
        Option(
            "--outline",
            help="Polygons over which to compute change, such as glaciers of an inventory; without, the difference alone.",
        ),
    ] = None
    select: Select = field(default_factory=list)
    stable: Annotated[
        Path | None,
        Option("--stable", help="Ground that did not change; by default all outside the outlines."),
    ] = None
    align: Annotated[
        bool | None,
        Option(
            help="First correct shift, tilt and bias by curvature of the earlier survey; by default, unless both surveys state "
            "the same source."
        ),
    ] = None
    level: Annotated[bool, Option(help="Subtract the median difference of the unchanged ground.")] = True
    density_kg_m3: Annotated[
        float, Option("--density", help="Density of the gained or lost material [kg/m³].")
    ] = 850.0
    density_std_kg_m3: Annotated[float, Option("--density-std", help="Its standard deviation [kg/m³].")] = (
        60.0
    )
    flow: Annotated[
        str | None,
        Option(
            "--flow",
            help="Flow of the ice between the surveys: track, a file of firnline track, ice_motion.json, or four rasters "
            "EAST,NORTH,SIGMA_EAST,SIGMA_NORTH [m/day]; adds change along the flow and the flux divergence.",
        ),
    ] = None
    days: Annotated[
        float | None, Option("--days", min=1e-6, help="Time between the surveys, for velocities [days].")
    ] = None
    thickness: Annotated[
        str | None,
        Option(
            "--thickness",
            help="With --flow: thickness of the ice [m], or its raster; from the slope within a factor of two when left out.",
        ),
    ] = None
    thickness_error: Annotated[
        float,
        Option("--thickness-error", min=0.0, help="Standard deviation of --thickness over the thickness."),
    ] = 0.2
    crs: Annotated[
        str | None, Option("--crs", help="CRS of surveys that carry none or a local one (LOCAL_CS).")
    ] = None
    datum: Annotated[str | None, Option("--datum", help="Vertical datum of surveys that state none.")] = None
    units: Lengths = None
    step_m: Annotated[
        float, Option("--grid", help="Distance between nodes when terrain models are compared [m].")
    ] = 2.0
    out: Annotated[
        Path, Option("--out", "-o", help="Folder for change.tif, .csv, .gpkg, .json and the picture.")
    ] = Path("change")
    report: Annotated[
        Path | None, Option("--report", help="Write a report: a folder, or a file .html or .pdf.")
    ] = None
    details: Details = field(default_factory=list)
    force: Annotated[bool, Option("--force", help="Replace a change that is there.")] = False

    @property
    def inputs(self) -> tuple[Path | None, ...]:
        """Every file that is read."""
        return self.later, self.earlier, self.outline, self.stable

    def check(self) -> None:
        """Refuse options without what they belong to, outputs that exist or are inputs, and a report of an unknown form."""
        self._refuse_unused()
        inputs = with_companions(self.inputs)
        refuse_existing([self.out], force=self.force, inputs=inputs, own=OUTPUTS)
        if stated_details(self.details) and self.report is None:
            raise survey.InputError("--detail is stated in a report; add --report, or leave --detail out.")
        if self.report is None:
            return
        from survey.reporting.document import OUTPUTS as REPORT_OUTPUTS
        from survey.reporting.document import check_target

        own = () if check_target(self.report).suffix else REPORT_OUTPUTS
        refuse_existing([self.report], force=self.force, inputs=inputs, own=own)

    def _refuse_unused(self) -> None:
        """Refuse options of the flow without a flow, and a flow or no outline between terrain models."""
        stated = [
            name for name, value in {"--days": self.days, "--thickness": self.thickness}.items() if value
        ]
        if not _DENSITIES_KG_M3[0] <= self.density_kg_m3 <= _DENSITIES_KG_M3[1]:
            raise ConfigError(
                f"--density is {self.density_kg_m3:g}; {_DENSITIES_KG_M3[0]:g} to {_DENSITIES_KG_M3[1]:,g} kg/m³ were expected, "
                "such as 850 for ice and firn."
            )
        if self.outline is None and (self.select or self.later.suffix == ".npz"):
            what = "--select chooses polygons" if self.select else "terrain models are compared over polygons"
            raise survey.InputError(f"{what}; add --outline with their file.")
        if self.flow is None and stated:
            raise survey.InputError(f"{stated[0]} belongs to --flow; add --flow, or leave {stated[0]} out.")
        if self.flow is not None and self.later.suffix == ".npz":
            raise survey.InputError(
                "--flow compares maps, and the surveys are terrain models; name their maps."
            )


@dataclass(frozen=True, kw_only=True)
class ChangeResult(WrittenResult):
    """Change between two surveys.

    Parameters
    ----------
    request : ChangeRequest
        What was asked for.
    change : Change
        The change.
    outlines : dict
        Polygons by name.
    """

    request: ChangeRequest
    change: "Change"
    outlines: dict[str, Any]

    def _write_files(self) -> None:
        """Write the folder of the change, and the report if one is asked for."""
        from survey.core import replacing_folder
        from survey.scoring.differencing.change_files import write_change

        with replacing_folder(self.request.out, own=OUTPUTS) as draft:
            write_change(draft, self.change, *self._density, outlines=self.outlines)
            self.request.write_pictures(draft, self._pictures)
        if self.request.report is not None:
            self._write_report(self.request.report)

    def _pictures(self) -> dict[str, "Figure"]:
        from survey.figures import change_map

        return {"change": change_map(self.change, self.outlines)}

    @property
    def _density(self) -> tuple[float, float]:
        return self.request.density_kg_m3, self.request.density_std_kg_m3

    def facts(self) -> dict[str, Any]:
        """Return alignment, level, statistics, volumes, masses and notes."""
        from survey.scoring.differencing.change_files import change_facts

        return change_facts(self.change, *self._density)

    def lines(self) -> list[str]:
        """Return what was changed before the comparison, volumes and masses, and where they were written."""
        lines = [*_change_lines(self.facts()), f"written to {self.request.out}"]
        report = self.request.report
        return lines if report is None else [*lines, f"report written to {report}"]

    def _write_report(self, report: Path) -> None:
        from survey.reporting.accuracy import ReportSetting, change_report
        from survey.reporting.document import write_document

        roles = ("Later survey", "Earlier survey", "Outlines", "Unchanged ground from")
        inputs = zip(roles, self.request.inputs, strict=True)
        names = {role: path.name for role, path in inputs if path is not None}
        title = f"{names['Later survey']} minus {names['Earlier survey']}"
        setting = ReportSetting(title, today(), {**stated_details(self.request.details), **names})
        document = change_report(setting, self.change, self.outlines, self.facts())
        write_document(report, document, self.request.pictures)


def preview_change(request: ChangeRequest) -> Preview:
    """Read surveys and outlines, and return what would be compared."""
    from survey.scoring.differencing.change_files import read_outlines

    request.check()
    writes = [request.out, *([] if request.report is None else [request.report])]
    surveys = {"later": request.later, "earlier": request.earlier}
    if all(source.suffix == ".npz" for source in surveys.values()):
        return Preview.of(writes)
    *read, _ = surveys_of(request)
    dems = dict(zip(surveys, (one if isinstance(one, survey.Dem) else one.mean for one in read), strict=True))
    facts = {name: "{} × {} cells".format(*dem.shape) for name, dem in dems.items()}
    if request.outline is not None:
        facts["outlines"] = ", ".join(read_outlines(request.outline, dems["later"].crs, request.select))
    return Preview.of(writes, {**facts, "aligned": "yes" if _is_aligned(request) else "no"})


@previewed_by(preview_change)
def change(request: ChangeRequest) -> ChangeResult:
    """Compute the change of elevation, volume and mass on the ground, with correlated errors.

    Parameters
    ----------
    request : ChangeRequest
        Surveys, outlines and settings.

    Returns
    -------
    ChangeResult
        The change; `ChangeResult.write` writes it.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    ConfigError
        A density that is no density, or a flow that cannot be read.
    """
    request.check()
    found, outlines = _compared(request)
    return ChangeResult(request=request, change=found, outlines=outlines)


def _compared(request: ChangeRequest) -> tuple["Change", dict[str, Any]]:
    """Compare two terrain models by their posteriors, anything else by the unchanged ground."""
    import shapely

    from survey.scoring.differencing.change_files import Glaciers, read_glaciers, read_outlines
    from survey.scoring.differencing.difference import change as compare

    if request.later.suffix == request.earlier.suffix == ".npz":
        return _models_compared(request)
    new, old, note = surveys_of(request)
    crs = (new if isinstance(new, survey.Dem) else new.mean).crs
    glaciers = Glaciers({}, {})
    if request.outline is not None:
        glaciers = read_glaciers(request.outline, crs, request.select)
    ground = None
    if request.stable is not None:
        ground = shapely.union_all(list(read_outlines(request.stable, crs).values()))
    flow, thickness = flow_between(
        request.flow, request.days, (request.thickness, request.thickness_error), (new, old)
    )
    found = compare(
        new,
        old,
        glaciers.shapes,
        stable=ground,
        align=_is_aligned(request),
        level=request.level,
        flow=flow,
        thickness=thickness,
    )
    volumes = tuple(replace(one, identifier=glaciers.identifiers[one.name]) for one in found.volumes)
    return replace(found, notes=(*found.notes, *note), volumes=volumes), glaciers.shapes


def _is_aligned(request: ChangeRequest) -> bool:
    """Return what --align or --no-align says; else whether the surveys do not state the same source."""
    if request.align is not None:
        return request.align
    from survey.io.raster.reading import stated_source

    files = [one / "dem.tif" if one.is_dir() else one for one in (request.later, request.earlier)]
    later, earlier = map(stated_source, files)
    return not later or later != earlier


def _models_compared(request: ChangeRequest) -> tuple["Change", dict[str, Any]]:
    import shapely

    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
    from survey.scoring.differencing.change_files import read_outlines
    from survey.scoring.differencing.difference import change_of_models

    later, earlier = request.later, request.earlier
    new, old = GaussianProcessTerrain.load(later), GaussianProcessTerrain.load(earlier)
    crs = getattr(new.prior, "crs", None) or getattr(old.prior, "crs", None)
    if crs is None:
        raise survey.InputError(
            f"{later} and {earlier} carry no coordinate reference system (models built on a raster do); "
            "compare their maps instead."
        )
    assert request.outline is not None
    outlines = read_outlines(request.outline, crs, request.select)
    bounds = shapely.union_all(list(outlines.values())).bounds
    return change_of_models(new, old, outlines, survey.Grid.over(bounds, request.step_m, crs)), outlines


def _change_lines(facts: dict[str, Any]) -> list[str]:
    """Return corrections, statistics, volumes and notes as sentences."""
    lines = _correction_lines(facts)
    row = facts["difference"]
    lines.append(
        f"later - earlier on {row['n']:,} common cells: median {row['median_m']:+.3f} m, mean {row['mean_m']:+.3f} m, "
        f"NMAD {row['nmad_m']:.3f} m, RMSE {row['rmse_m']:.3f} m, 95 % within {row['p95_m']:.3f} m"
    )
    total = [] if facts["total"] is None else [facts["total"]]
    lines += [_volume_line(row) for row in (*facts["volumes"], *total)]
    lines += [_flow_line(row) for row in facts.get("along_flow", ())]
    return [*lines, *(f"note: {note}" for note in facts["notes"])]


def _correction_lines(facts: dict[str, Any]) -> list[str]:
    """Return what was corrected before the comparison, with its standard deviations."""
    lines, found = [], facts["alignment"]
    if found is not None:

        def term(name: str, unit: str) -> str:
            return f"{found[name]:+.3f} ± {found['std'].get(name, 0.0):.3f} {unit}"

        lines.append(
            f"earlier survey aligned (--no-align does not): shift {term('east_m', 'm')} east, {term('north_m', 'm')} north, "
            f"{term('up_m', 'm')} up; tilt {term('tilt_east_m_per_km', 'm/km')} east, {term('tilt_north_m_per_km', 'm/km')} north; "
            f"bias by curvature {term('curvature_bias_m2', 'm²')}"
        )
    if facts["offset_m"]:
        lines.append(
            f"{facts['offset_m']:+.3f} m subtracted, the median difference of the unchanged ground (--no-level does not)"
        )
    return lines


def _volume_line(row: dict[str, Any]) -> str:
    """Return the change of volume and mass within one outline as a sentence."""
    return (
        f"{printable(row['name'])}: {_signed(row['volume_change_m3'])} m³, 95 % between "
        f"{_signed(row['volume_low_95_m3'])} and {_signed(row['volume_high_95_m3'])}; {row['mean_change_m']:+.3f} m on the mean, "
        f"{row['specific_mass_balance_m_we']:+.3f} ± {row['specific_std_m_we']:.3f} m w.e."
    )


def _flow_line(row: dict[str, Any]) -> str:
    """Return the change along the flow and the balance of one outline as a sentence."""
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


class Surveys(NamedTuple):
    """Later and earlier survey, and notes on how they were read."""

    later: "survey.Reconstruction | survey.Dem"
    earlier: "survey.Reconstruction | survey.Dem"
    notes: tuple[str, ...] = ()


def surveys_of(request: ChangeRequest) -> Surveys:
    """Read two surveys; rasters of more cells than a change in memory takes are averaged over squares."""
    from survey.scoring.differencing.change_files import average_survey, averaged_step_m

    files = [request.later, request.earlier]
    step_m = averaged_step_m(files) if all(map(_is_raster, files)) else None
    if step_m is None:
        return Surveys(_survey(request.later, request), _survey(request.earlier, request))
    note = f"the surveys were averaged over squares of about {step_m:.3g} m before the comparison."
    new, old = (
        with_datum(average_survey(file, step_m, request.crs, request.units), request.datum, file)
        for file in files
    )
    return Surveys(new, old, (note,))


def _is_raster(source: Path) -> bool:
    return source.is_file() and source.suffix != ".npz"


def _survey(source: Path, request: ChangeRequest) -> "survey.Reconstruction | survey.Dem":
    """Read a map that is no terrain model."""
    if source.suffix == ".npz":
        raise survey.InputError(
            f"{source} is a terrain model and the other survey is none; compare two models, or two maps."
        )
    return map_of(source, request.crs, units=request.units, datum=request.datum)
