"""Site, tiles and heights over the server."""

import io

import numpy as np
import pytest
from PIL import Image

from tests.desk.conftest import SOUTH, WEST


def test_the_site_states_crs_and_grid(page):
    site = page.get("/api/site").json()
    assert site["crs"]["code"] == "EPSG:32608"
    assert site["tiles"]["resolutions_m"] == [45.0]
    assert 0.999 < site["grid_per_ground"] < 1.0


def test_every_field_has_help(page):
    fields = page.get("/api/fields").json()
    sections = [*fields["planner"].values(), fields["rover"], fields["fleet"]]
    sections += [fields["requirement"], fields["simulation"]]
    described = {field["name"]: field["help"] for section in sections for field in section}
    assert "Largest slope" in described["max_pitch_deg"]
    simulated = {field["name"]: field for field in fields["simulation"]}
    assert simulated["fidelity"]["choices"] == ["ideal", "statistical", "vision"]
    assert simulated["seed"]["kind"] == "integer"
    assert all(described.values())


@pytest.mark.parametrize("layer", ["relief", "slope"])
def test_a_tile_is_a_picture_with_unknown_ground_left_out(page, layer):
    answer = page.get(f"/tiles/{layer}/0/0/0.png")
    pixels = np.asarray(Image.open(io.BytesIO(answer.content)))
    assert pixels.shape == (256, 256, 4)
    assert pixels[30:, :, 3].max() == 0
    assert pixels[:2, :2, 3].max() == 0
    assert pixels[8:18, 8:18, 3].max() > 0


@pytest.mark.parametrize(
    "path", ["relief/1/0/0", "relief/0/1/0", "relief/0/0/9999999999999999999999", "other/0/0/0"]
)
def test_a_tile_that_does_not_exist_is_refused(page, path):
    assert page.get(f"/tiles/{path}.png").status_code == 404


def test_the_colours_are_stretched_over_what_is_looked_at(page):
    everything = f"{WEST},{SOUTH},{WEST + 900},{SOUTH + 900}"
    part = f"{WEST + 400},{SOUTH + 400},{WEST + 550},{SOUTH + 550}"
    wide = page.get(f"/api/style?bounds={everything}").json()
    close = page.get(f"/api/style?bounds={part}").json()
    assert wide["high_m"] - wide["low_m"] > 1.3 * (close["high_m"] - close["low_m"])
    coloured = [page.get(f"/tiles/relief/0/0/0.png?style={one['text']}").content for one in (wide, close)]
    assert coloured[0] != coloured[1]


def test_colours_that_still_fit_stay(page):
    bounds = f"{WEST + 10},{SOUTH + 10},{WEST + 890},{SOUTH + 890}"
    shown = page.get("/api/site").json()["style"]["text"]
    assert page.get(f"/api/style?bounds={bounds}&shown={shown}").json()["text"] == shown


@pytest.mark.parametrize("style", ["", "1,2", "a,b,c", "5,4,1", "0,1,0", "0,1,99", "nan,1,1", "-inf,inf,1"])
def test_unknown_colours_are_refused(page, style):
    assert page.get(f"/tiles/relief/0/0/0.png?style={style}").status_code == 422


@pytest.mark.parametrize("bounds", ["", "1,2,3", "a,b,c,d", "5,0,1,1", "0,0,inf,1", "nan,0,1,1"])
def test_wrong_bounds_are_refused(page, bounds):
    assert page.get(f"/api/style?bounds={bounds}").status_code == 422
    assert page.get(f"/api/contours?bounds={bounds}").status_code == 422


def test_contours_run_along_their_height(page):
    found = page.get(f"/api/contours?bounds={WEST},{SOUTH},{WEST + 900},{SOUTH + 900}").json()
    line = max(found["lines"], key=lambda one: len(one["places"]))
    heights = page.post("/api/heights", {"places": line["places"][:50]}).json()["heights_m"]
    assert heights == pytest.approx([line["height_m"]] * len(heights), abs=0.6)
    assert line["is_index"] == (round(line["height_m"] / found["interval_m"]) % 5 == 0)


def test_contours_beyond_the_terrain_are_none(page):
    assert page.get("/api/contours?bounds=0,0,10,10").json()["lines"] == []


def test_heights_are_those_of_the_terrain(page, workspace):
    from survey.data.dem import Dem

    places = [[WEST + 333.3, SOUTH + 444.4], [WEST + 12.0, SOUTH + 880.0], [0.0, 0.0]]
    found = page.post("/api/heights", {"places": places}).json()["heights_m"]
    assert found[0] == pytest.approx(float(Dem.read(workspace.terrain).at(places[:1])[0]), abs=2e-3)
    assert found[1] is None
    assert found[2] is None


@pytest.mark.parametrize("places", [None, [], [[1.0]], [["a", "b"]], [[0.0, 0.0]] * 2001, {"x": 1}])
def test_wrong_places_are_refused(page, places):
    assert page.post("/api/heights", {"places": places}).status_code == 422
