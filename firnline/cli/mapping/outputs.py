"""Outputs of ``firnline reconstruct``: the folder of a map, and what is printed of it."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import typer

import survey
from firnline.cli.facts import fact_line, figure_lines
from survey.core.replacement import replacing_folder
from survey.data.ice_motion import ICE_MOTION, IceMotion, write_motion
from survey.reconstruction.beyond_points import beyond_sentences
from survey.reconstruction.terrain_map import ELEVATION

OWN_FILES = (
    *("dem.tif", "support.tif", "bounds.tif", "no_go.tif", "reconstruction.json"),
    *("mean.png", "sigma.png", "width.png", "support.png"),
    ICE_MOTION,
    *("corrected_trajectory*.csv", "corrected_trajectory*.error.npz", "*.aux.xml"),
)
"""Patterns of the files that a reconstruction consists of."""
_BOUNDING_BOX = "bounding box of the points"
_MOST_DRAWN_NODES = 4_000_000


class MadeMap(NamedTuple):
    """A map, how it was made, the area that was named, the corrected path of each drive of a joint map, and the ice's motion."""

    reconstruction: survey.Reconstruction
    origin: str
    area: Path | None = None
    corrected: Sequence[survey.Trajectory] = ()
    motion: IceMotion | None = None


def write_map(made: MadeMap, out: Path, *, rays: bool, max_slope_deg: float | None) -> None:
    """Write the map into a new folder that replaces the old one when it is complete."""
    with replacing_folder(out, own=OWN_FILES) as draft:
        _with_area(made).write(draft)
        for k, path in enumerate(made.corrected, 1):
            number = "" if len(made.corrected) == 1 else f"_{k}"
            path.write(draft / f"corrected_trajectory{number}.csv")
        if made.motion is not None:
            write_motion(made.motion, draft / ICE_MOTION)
        _draw(made.reconstruction, draft)
        if rays:
            _mark(made.reconstruction, draft, max_slope_deg)


def _with_area(made: MadeMap) -> survey.Reconstruction:
    """Return the map with the area that it covers in its record."""
    diagnostics = {**made.reconstruction.diagnostics, "area": _area_text(made.area)}
    return replace(made.reconstruction, diagnostics=diagnostics)


def _area_text(area: Path | None) -> str:
    return _BOUNDING_BOX if area is None else str(area)


def _draw(result: survey.Reconstruction, out: Path) -> None:
    """Write pictures of mean, standard deviation and support; large maps have none, and a log entry says so."""
    from survey.figures import deviation_map, support_map, survey_map
    from survey.figures.style import png_bytes

    if result.quantity != ELEVATION:
        return
    if result.support.size > _MOST_DRAWN_NODES:
        logging.getLogger(__name__).warning(
            "the map has %s nodes; pictures are drawn of up to %s.",
            f"{result.support.size:,}",
            f"{_MOST_DRAWN_NODES:,}",
        )
        return
    figures = {
        "mean": survey_map(result.mean),
        "sigma": deviation_map(result),
        "support": support_map(result),
    }
    for name, figure in figures.items():
        (out / f"{name}.png").write_bytes(png_bytes(figure))


def _mark(result: survey.Reconstruction, out: Path, max_slope_deg: float | None) -> None:
    """Write a picture of the width between the bounds, and the ground that is certainly too steep."""
    from survey.figures.maps import width_map
    from survey.figures.style import png_bytes
    from survey.reconstruction.hazards import steep_ground

    if result.lower is None or result.upper is None:
        return
    (out / "width.png").write_bytes(png_bytes(width_map(result)))
    if max_slope_deg is not None:
        steep_ground(result, max_slope_deg).write(out / "no_go.tif")


def print_map(made: MadeMap, out: Path, *, as_json: bool) -> None:
    """Print what was made, for people or as JSON."""
    if as_json:
        typer.echo((out / "reconstruction.json").read_text(encoding="utf-8"))
        return
    result = made.reconstruction
    rows, columns = result.mean.shape
    typer.echo(f"{rows} × {columns} nodes {made.origin}, written to {out / 'dem.tif'}")
    hint = " (name a polygon with --area)" if made.area is None else ""
    typer.echo(fact_line("area", f"{_area_text(made.area)}{hint}"))
    for line in figure_lines(result.hyperparameters):
        typer.echo(line)
    _print_findings(result)
    if result.quantity == ELEVATION:
        typer.echo(
            fact_line(
                "next", f"firnline score {out / 'dem.tif'} --truth REFERENCE, or --checkpoints POINTS.csv"
            )
        )


def _print_findings(result: survey.Reconstruction) -> None:
    """Print the check by points left out, the classes by the map's claim, and what is to be known of the input."""
    from survey.scoring.standards.map_classes import own_claim

    for sentence in own_claim(result) if result.quantity == ELEVATION else beyond_sentences(result):
        typer.echo(fact_line("map", sentence))
    if result.method == "tin":
        typer.echo(
            fact_line(
                "map", "σ is that of the points alone, without the relief between them; no class is stated."
            )
        )
    share = result.diagnostics.get("prior_covered_share")
    if share is not None:
        typer.echo(fact_line("prior", f"covers {100.0 * share:.1f} % of the map; the rest has no height"))
    for found in result.diagnostics.get("blunders", ()):
        typer.echo(fact_line("left out", f"{found['file']}: {found['sentence']}"))
    n_low = result.diagnostics.get("n_low_returns", 0)
    if n_low:
        typer.echo(fact_line("left out", f"{n_low} isolated low returns"))
    offset_m = result.diagnostics.get("satellite_offset_m")
    if offset_m is not None:
        sigma_m = result.diagnostics["satellite_offset_m_sigma"]
        typer.echo(fact_line("prior", f"lies {offset_m:+.2f} ± {sigma_m:.2f} m from the map"))
    for conflict in result.diagnostics.get("prior_conflicts", ()):
        typer.echo(fact_line("warning", conflict))
