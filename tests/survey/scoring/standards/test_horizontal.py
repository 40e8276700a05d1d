"""Horizontal and three-dimensional accuracy at marks that were found in the map, under the NSSDA and Edition 2."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid, InputError
from survey.reporting.statements import statement
from survey.scoring import Checkpoints, compare, score_at
from survey.scoring.standards.checkpoint_errors import CheckpointErrors

CRS = "EPSG:32608"
ED2, NSSDA = "asprs-edition-2", "nssda-1998"
N = 36


def flat() -> Dem:
    grid = Grid((0.0, 0.0, 600.0, 600.0), 10.0, CRS)
    return Dem.on(grid, np.full(grid.shape, 100.0))


def errors(
    east_m: float = 0.06, north_m: float = 0.08, n: int = N, sigma_xy_m: float = 0.02, vegetated: int = 0
) -> CheckpointErrors:
    """Marks whose shifts alternate in sign, so that their root mean squares are those given."""
    side = np.linspace(50.0, 550.0, 6)
    places = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)[:n]
    sign = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    shift = np.column_stack([east_m * sign, north_m * sign])
    xyz = np.column_stack([places, 100.0 - 0.03 * sign])
    cover = np.arange(n) < vegetated
    points = Checkpoints(xyz, 0.01, CRS, map_xy=places + shift, sigma_xy_m=sigma_xy_m, vegetated=cover)
    return compare(flat(), points)


def findings(found: CheckpointErrors, standard: str = ED2, **classes: float):
    judged = score_at(found, (standard,), **classes)
    return {(it.kind, it.is_vegetated): it for it in judged.assessments}


def test_rmse_h_adds_both_axes_and_the_survey_of_the_marks() -> None:
    it = findings(errors(), class_m=0.05, horizontal_class_m=0.15)["horizontal", False]
    assert it.value == pytest.approx(math.sqrt(0.06**2 + 0.08**2 + 0.02**2))
    assert it.outcome == "met"
    assert "for a 15 (cm) RMSE_H Horizontal Positional Accuracy Class" in statement(it)
    assert statement(it).endswith("was found to be RMSE_H = 10.2 (cm).")
    assert "Lagegenauigkeitsklasse 15 cm (RMSE_H)" in statement(it, "de")


def test_the_three_dimensional_class_joins_the_horizontal_and_the_vertical_one() -> None:
    found = findings(errors(), class_m=0.05, horizontal_class_m=0.12)
    it = found["3d", False]
    assert it.value == pytest.approx(math.sqrt(0.06**2 + 0.08**2 + 0.02**2 + 0.03**2 + 0.01**2))
    assert it.limit == pytest.approx(0.13)
    assert "for a 13 (cm) RMSE_3D" in statement(it)
    assert "within the NVA tested area" in statement(it)


def test_vegetated_ground_is_reported_in_space_without_a_limit() -> None:
    half = errors(vegetated=18)
    it = findings(half, class_m=0.05, horizontal_class_m=0.15)["3d", True]
    assert it.limit is None
    whole = dataclasses.replace(it, missing=(), outcome="reported")
    assert statement(whole).endswith("within the VVA tested area.")


def test_a_class_that_is_missed_or_too_few_marks_are_said() -> None:
    assert findings(errors(), horizontal_class_m=0.09)["horizontal", False].outcome == "not met"
    few = findings(errors(n=12), horizontal_class_m=0.15)["horizontal", False]
    assert few.outcome == "not assessed to the standard"
    assert "ONLY 12 checkpoints" in statement(few)
    coarse = findings(errors(sigma_xy_m=0.09), horizontal_class_m=0.15)["horizontal", False]
    assert any("placed to 0.075 m" in condition for condition in coarse.missing)


def test_a_mean_shift_and_blunders_are_to_be_investigated() -> None:
    moved = errors()
    shift = moved.shift_m + [0.05, 0.0]
    shift[3] = [1.0, 0.0]
    it = findings(dataclasses.replace(moved, shift_m=shift), horizontal_class_m=0.15)["horizontal", False]
    assert any(text.startswith("the mean shift") for text in it.cautions)
    assert any("at 4: investigate" in text for text in it.cautions)


def test_the_nssda_states_the_radius_of_95_per_cent_where_the_axes_agree() -> None:
    it = findings(errors(), NSSDA)["horizontal", False]
    assert it.value == pytest.approx(2.4477 * 0.07)
    assert statement(it) == "Tested 0.171 meters horizontal accuracy at 95% confidence level."
    uneven = findings(errors(east_m=0.02), NSSDA)["horizontal", False]
    assert uneven.outcome == "not assessed to the standard"
    assert "ratio above 0.6" in statement(uneven)


def test_the_worked_example_of_2014_gives_its_printed_radius() -> None:
    x, y = [-0.14, -0.1, 0.017, -0.07, 0.13], [-0.07, -0.1, -0.07, 0.15, 0.12]
    five = dataclasses.replace(errors(n=5), shift_m=np.column_stack([x, y]))
    assert findings(five, NSSDA)["horizontal", False].value == pytest.approx(0.255, abs=5e-4)


def test_places_in_the_map_without_their_uncertainty_are_refused() -> None:
    with pytest.raises(InputError, match="not how well they were placed"):
        Checkpoints([[0.0, 0.0, 1.0]], 0.01, CRS, map_xy=[[0.1, 0.0]])
    with pytest.raises(InputError, match="no checkpoint states where it was found in the map"):
        score_at(dataclasses.replace(errors(), shift_m=None), horizontal_class_m=0.1)


def test_the_command_reads_the_places_from_the_table(tmp_path: Path) -> None:
    flat().write(tmp_path / "map.tif")
    rows = ["Point,Easting,Northing,Elevation,SDV,SDH,Map East,Map North"]
    rows += [
        f"P{k},{50 + 15 * k},{60 + 14 * k},100.02,0.01,0.02,{50.05 + 15 * k},{59.96 + 14 * k}"
        for k in range(30)
    ]
    (tmp_path / "gnss.csv").write_text("\n".join(rows) + "\n")
    words = [
        "score",
        str(tmp_path / "map.tif"),
        "--checkpoints",
        str(tmp_path / "gnss.csv"),
        "--class",
        "0.1",
    ]
    page = ["--horizontal-class", "0.1", "--report", str(tmp_path / "page"), "--json"]
    done = CliRunner().invoke(app, [*words, *page])
    assert done.exit_code == 0, done.output
    kinds = {it["kind"]: it["outcome"] for it in json.loads(done.stdout)["assessments"]}
    assert kinds == {"vertical": "met", "horizontal": "met", "3d": "met"}
    text = (tmp_path / "page" / "index.html").read_text()
    assert "Horizontal Positional Accuracy Class" in text
    assert "Horizontal residual at each checkpoint" in text
    assert (tmp_path / "page" / "tables" / "shifts.csv").is_file()
