"""Compare two surveys: change of elevation, volume and mass, also along the flow of the ice."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import survey
from firnline.actions.change_request import (
    OUTPUTS,
    ChangeRequest,
    clouds_of,
    is_aligned,
    models_of,
    polygons_of,
    surveys_of,
)
from firnline.actions.interface import Preview, WrittenResult, previewed_by
from firnline.actions.requests import stated_details
from firnline.actions.score_request import today
from firnline.actions.tracking import flow_between
from survey.core import printable

_STEP_M = 2.0

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from survey.scoring.differencing.change_files import Glaciers
    from survey.scoring.differencing.cloud_change import CloudChange
    from survey.scoring.differencing.volume_change import Change, VolumeChange


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


@dataclass(frozen=True, kw_only=True)
class CloudChangeResult(WrittenResult):
    """Change between two point clouds.

    Parameters
    ----------
    request : ChangeRequest
        What was asked for.
    change : CloudChange
        The change.
    outlines : dict
        Polygons by name.
    """

    request: ChangeRequest
    change: "CloudChange"
    outlines: dict[str, Any]

    def _write_files(self) -> None:
        from survey.core import replacing_folder

        with replacing_folder(self.request.out, own=OUTPUTS) as draft:
            self.change.write(draft, *self._density, outlines=self.outlines)
            self.request.write_pictures(draft, self._pictures)

    def _pictures(self) -> dict[str, "Figure"]:
        from survey.figures import change_map, distance_map

        figures = {"change_points": distance_map(self.change.distances, self.outlines)}
        if self.change.change is not None:
            figures["change"] = change_map(self.change.change, self.outlines)
        return figures

    @property
    def _density(self) -> tuple[float, float]:
        return self.request.density_kg_m3, self.request.density_std_kg_m3

    def facts(self) -> dict[str, Any]:
        """Return distances, their levels of detection and scales, and what `ChangeResult.facts` has of the map."""
        return self.change.facts(*self._density)

    def lines(self) -> list[str]:
        """Return what was compared, the distances and their levels of detection, volumes, and where they were written."""
        facts = self.facts()
        return [*_distance_lines(facts["m3c2"]), *_outcome_lines(facts), f"written to {self.request.out}"]


def preview_change(request: ChangeRequest) -> Preview:
    """Read surveys and outlines, and return what would be compared."""
    from survey.scoring.differencing.change_files import read_outlines

    request.check()
    writes = [request.out, *([] if request.report is None else [request.report])]
    surveys = {"later": request.later, "earlier": request.earlier}
    if all(source.suffix == ".npz" for source in surveys.values()):
        return Preview.of(writes)
    if request.method is not None:
        *clouds, notes = clouds_of(request)
        counts = {name: f"{len(cloud):,} points" for name, cloud in zip(surveys, clouds, strict=True)}
        return Preview.of(writes, counts, notes)
    *read, _ = surveys_of(request)
    dems = dict(zip(surveys, (one if isinstance(one, survey.Dem) else one.mean for one in read), strict=True))
    facts = {name: "{} × {} cells".format(*dem.shape) for name, dem in dems.items()}
    if request.outline is not None:
        facts["outlines"] = ", ".join(read_outlines(request.outline, dems["later"].crs, request.select))
    return Preview.of(writes, {**facts, "aligned": "yes" if is_aligned(request) else "no"})


@previewed_by(preview_change)
def change(request: ChangeRequest) -> "ChangeResult | CloudChangeResult":
    """Compute the change of elevation, volume and mass on the ground, with correlated errors.

    Parameters
    ----------
    request : ChangeRequest
        Surveys, outlines and settings.

    Returns
    -------
    ChangeResult or CloudChangeResult
        The change, of point clouds with the method ``m3c2``; its `write` writes it.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    ConfigError
        A density that is no density, or a flow that cannot be read.
    """
    request.check()
    if request.method is not None:
        return _clouds_compared(request)
    found, outlines = _compared(request)
    return ChangeResult(request=request, change=found, outlines=outlines)


def _clouds_compared(request: ChangeRequest) -> CloudChangeResult:
    """Compare two point clouds by M3C2."""
    from survey.scoring.differencing.cloud_change import change_of_clouds

    later, earlier, notes = clouds_of(request)
    glaciers, ground = polygons_of(request, earlier.crs)
    found = change_of_clouds(
        later,
        earlier,
        glaciers.shapes,
        stable=ground,
        level=request.level,
        registration_m=request.registration_m,
        normals_m=tuple(request.normals_m),
        cylinder_m=request.cylinder_m,
        depth_m=request.depth_m,
        spacing_m=request.step_m,
    )
    if found.change is not None:
        named = replace(found.change, volumes=_identified(found.change, glaciers))
        found = replace(found, change=named)
    found = replace(found, notes=(*notes, *found.notes))
    return CloudChangeResult(request=request, change=found, outlines=glaciers.shapes)


def _identified(found: "Change", glaciers: "Glaciers") -> tuple["VolumeChange", ...]:
    """Return the volumes with the identifiers of an inventory."""
    return tuple(replace(one, identifier=glaciers.identifiers[one.name]) for one in found.volumes)


def _compared(request: ChangeRequest) -> tuple["Change", dict[str, Any]]:
    """Compare two terrain models by their posteriors, anything else by the unchanged ground."""
    from survey.scoring.differencing.difference import change as compare

    if request.later.suffix == request.earlier.suffix == ".npz":
        return _models_compared(request)
    new, old, note = surveys_of(request)
    crs = (new if isinstance(new, survey.Dem) else new.mean).crs
    glaciers, ground = polygons_of(request, crs)
    flow, thickness = flow_between(
        request.flow, request.days, (request.thickness, request.thickness_error), (new, old)
    )
    found = compare(
        new,
        old,
        glaciers.shapes,
        stable=ground,
        align=is_aligned(request),
        level=request.level,
        flow=flow,
        thickness=thickness,
    )
    notes = (*found.notes, *note)
    return replace(found, notes=notes, volumes=_identified(found, glaciers)), glaciers.shapes


def _models_compared(request: ChangeRequest) -> tuple["Change", dict[str, Any]]:
    import shapely

    from survey.scoring.differencing.change_files import read_outlines
    from survey.scoring.differencing.difference import change_of_models

    new, old, crs = models_of(request)
    assert request.outline is not None
    outlines = read_outlines(request.outline, crs, request.select)
    bounds = shapely.union_all(list(outlines.values())).bounds
    return change_of_models(
        new, old, outlines, survey.Grid.over(bounds, request.step_m or _STEP_M, crs)
    ), outlines


def _change_lines(facts: dict[str, Any]) -> list[str]:
    """Return corrections, statistics, volumes and notes as sentences."""
    lines = _correction_lines(facts)
    row = facts["difference"]
    lines.append(
        f"later - earlier on {row['n']:,} common cells: median {row['median_m']:+.3f} m, mean {row['mean_m']:+.3f} m, "
        f"NMAD {row['nmad_m']:.3f} m, RMSE {row['rmse_m']:.3f} m, 95 % within {row['p95_m']:.3f} m"
    )
    return [*lines, *_outcome_lines(facts)]


def _outcome_lines(facts: dict[str, Any]) -> list[str]:
    """Return volumes, balances along the flow and notes as sentences."""
    total = [] if facts.get("total") is None else [facts["total"]]
    lines = [_volume_line(row) for row in (*facts.get("volumes", ()), *total)]
    lines += [_flow_line(row) for row in facts.get("along_flow", ())]
    return [*lines, *(f"note: {note}" for note in facts["notes"])]


def _distance_lines(found: dict[str, Any]) -> list[str]:
    """Return the lengths of a comparison of clouds, the distances, and their levels of detection as sentences."""
    scales = found["scales"]
    normals = ", ".join(f"{length:.4g}" for length in scales["normals_m"])
    source = {"stated": "as stated", "unchanged ground": "from the unchanged ground"}
    lines = [
        f"cylinders of {scales['cylinder_m']:.4g} m across, {scales['depth_m']:.4g} m to each side; normals from {normals} m; core points "
        f"every {scales['spacing_m']:.4g} m",
    ]
    if found["offset_m"]:
        lines.append(
            f"{found['offset_m']:+.3f} m of height subtracted, the median difference of the unchanged ground (--no-level does not)"
        )
    return [
        *lines,
        f"later - earlier along the normal at {found['n']:,} core points: median {found['median_m']:+.3f} m, mean {found['mean_m']:+.3f} m, "
        f"NMAD {found['nmad_m']:.3f} m, 95 % within {found['p95_m']:.3f} m",
        f"level of detection at 95 %: median {found['median_lod_m']:.3f} m, with a registration error of {found['registration_m']:.3f} m "
        f"{source[found['registration_from']]}; {found['significant_share']:.0%} of the core points changed by more",
    ]


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
