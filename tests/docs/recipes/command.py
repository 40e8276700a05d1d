"""A command: the slopes of a raster."""

from tests.docs.recipes.recipe import Recipe

COMMAND = Recipe(
    "Add a command",
    2,
    added={
        "firnline/actions/sloping.py": '''"""Slopes of a raster of elevations."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import survey
from firnline.actions.interface import (
    Argument,
    Option,
    Preview,
    WrittenResult,
    fact_line,
    figure_lines,
    previewed_by,
    refuse_existing,
)


@dataclass(frozen=True, kw_only=True)
class SlopesRequest:
    """Raster whose slopes are wanted."""

    dem: Annotated[Path, Argument(help="Elevation raster.")]
    out: Annotated[Path, Option("--out", "-o", help="Slopes to write (.tif) [deg].")] = Path("slopes.tif")
    force: Annotated[bool, Option("--force", help="Replace an existing file.")] = False


@dataclass(frozen=True)
class SlopesResult(WrittenResult):
    """Slopes of a raster [deg]."""

    request: SlopesRequest
    slopes: survey.Dem

    def _write_files(self) -> None:
        self.slopes.write(self.request.out, "slope_deg")

    def facts(self) -> dict[str, Any]:
        """Return the steepest slope."""
        import numpy as np

        return {"largest_slope_deg": float(np.nanmax(self.slopes.elevation))}

    def lines(self) -> list[str]:
        """Return the steepest slope, and the place of the file."""
        return [*figure_lines(self.facts()), fact_line("written to", self.request.out)]


def _read(request: SlopesRequest) -> survey.Dem:
    refuse_existing([request.out], force=request.force, inputs=[request.dem])
    return survey.Dem.read(request.dem)


def preview_slopes(request: SlopesRequest) -> Preview:
    """Read the raster, and return what would be written."""
    return Preview.of([request.out], {"raster": "{} × {} cells".format(*_read(request).shape)})


@previewed_by(preview_slopes)
def slopes(request: SlopesRequest) -> SlopesResult:
    """Compute the slopes of a raster."""
    return SlopesResult(request, _read(request).slope())
'''
    },
    inserted={
        "firnline/cli/scoring.py": (
            (
                "from firnline.actions.interface import",
                "from firnline.actions.sloping import SlopesRequest\n",
            ),
            (
                "COMMANDS = {",
                '''@with_exit_codes
@with_options_of(SlopesRequest)
def slopes(request: SlopesRequest, dry_run: DryRun = False, as_json: Json = False) -> None:
    """Write the slopes of a raster.

    For example:

      firnline slopes dem.tif -o slopes.tif
    """
    from firnline.actions import sloping

    perform(sloping.slopes, request, dry_run=dry_run, as_json=as_json)


''',
            ),
            ("score, change, track)", "slopes, "),
        )
    },
    check="""
import json
from pathlib import Path
import numpy as np
from firnline import Dem, Grid
from firnline.actions.sloping import SlopesRequest, slopes
grid = Grid((500_000.0, 6_700_000.0, 500_090.0, 6_700_090.0), 10.0, "EPSG:32608")
Dem.on(grid, grid.xy[:, 0].reshape(grid.shape) - 500_000.0).write("dem.tif")
command("slopes", "dem.tif", "-o", "a.tif", "--dry-run")
assert not Path("a.tif").exists()
command("slopes", "dem.tif", "-o", "a.tif")
made = slopes(SlopesRequest(dem=Path("dem.tif"))).write(Path("b.tif"))
assert Path("a.tif").read_bytes() == Path("b.tif").read_bytes()
printed = CliRunner().invoke(app, ["slopes", "dem.tif", "-o", "c.tif", "--json"]).stdout
assert json.loads(printed) == made.facts()
assert abs(made.facts()["largest_slope_deg"] - 45.0) < 1e-6
""",
)
