"""Functions of the public interface refuse arguments of a wrong type."""

import pytest

import firnline

AREA = firnline.SurveyArea.rectangle((0.0, 0.0, 60.0, 60.0), "EPSG:32608")
GRID = firnline.Grid(AREA.bounds, 10.0, AREA.crs)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: firnline.plan(AREA, None, "lawnmower"), r"plan\(\) was given a str for 'config'"),
        (
            lambda: firnline.plan("area.gpkg", None, firnline.LawnmowerConfig(swaths=2)),
            "'area'; a SurveyArea was",
        ),
        (
            lambda: firnline.reconstruct([[0.0, 0.0, 1.0]], GRID),
            "a list for 'points'; a SurfacePoints was expected",
        ),
        (
            lambda: firnline.score(GRID, truth=GRID),
            "'reconstruction'; a Reconstruction or a Dem was expected",
        ),
        (
            lambda: firnline.change("a.tif", "b.tif", {}),
            "a str for 'later'; a Dem or a Reconstruction was expected",
        ),
        (lambda: firnline.localize("recording"), "a str for 'recording'; a Recording was expected"),
        (lambda: firnline.simulate(GRID, None), "a Grid for 'terrain'; a Dem was expected"),
    ],
)
def test_the_message_names_the_argument_and_what_was_expected(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_a_wrong_setting_is_a_config_error():
    with pytest.raises(firnline.ConfigError, match="did you mean swaths"):
        firnline.LawnmowerConfig(swath=3)
