"""Maps show the data they were given, in true proportions, comparable ones in the same colours."""

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex

from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Leg, Route
from survey.figures import deviation_map, landmark_map, support_map, survey_map, terrain_comparison
from survey.figures.layout import view
from survey.figures.map_layers import decimate, elevation_limits, relief_exaggeration
from survey.figures.style import ROVERS, png_bytes


def rasters(axes):
    """Meshes of data, without the shading that lies over them."""
    return [mesh for mesh in meshes(axes) if mesh.get_array().ndim == 2]


def meshes(axes):
    return [mesh for mesh in axes.collections if isinstance(mesh, QuadMesh)]


def texts(figure):
    legends = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    return legends + [text.get_text() for axes in figure.axes for text in axes.texts]


def test_the_survey_map_shows_the_terrain_with_its_coordinates(site):
    axes = survey_map(site.truth, area=site.area, route=site.route).axes[0]
    (image,) = rasters(axes)
    np.testing.assert_array_equal(image.get_array(), site.truth.elevation)
    xmin, ymin, xmax, ymax = site.truth.bounds
    corners = image.get_coordinates()[[0, -1], [0, -1]]
    assert corners.tolist() == [[xmin, ymax], [xmax, ymin]]
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Easting [m]", "Northing [m]")


def test_swaths_are_numbered_and_transits_dashed_in_the_colour_of_their_rover(site):
    figure = survey_map(site.truth, area=site.area, route=site.route)
    legs = [line for line in figure.axes[0].lines if len(line.get_xdata()) >= 2]
    assert len(legs) == len(site.route.legs)
    for line, leg in zip(legs, site.route.legs, strict=True):
        np.testing.assert_array_equal(np.column_stack(line.get_data()), leg.xy)
        assert to_hex(line.get_color()) == ROVERS[leg.rover]
        assert line.is_dashed() == (leg.kind == "transit")
    words = texts(figure)
    assert [words.count(number) for number in ("1", "2", "3")] == [2, 2, 0]
    assert {
        "Contours, 2 m",
        "Survey area",
        "No-go",
        "Rover 1, swaths (2)",
        "Rover 2, swaths (2)",
        "Transit",
    } <= set(words)


def test_one_rover_needs_no_name_and_many_swaths_few_numbers(site):
    legs = []
    for k in range(30):
        x = 500_010.0 + 6 * k
        swath = Leg("swath", [[x, 6_712_010.0], [x, 6_712_190.0]][:: 1 - 2 * (k % 2)])
        if legs:
            legs.append(Leg("transit", [legs[-1].xy[-1], swath.xy[0]]))
        legs.append(swath)
    words = texts(survey_map(site.truth, route=Route(tuple(legs), site.route.crs, "lawnmower")))
    assert "Swaths (30)" in words
    numbers = [int(word) for word in words if word.isdigit() and int(word) <= 30]
    assert numbers == [1, 4, 7, 10, 13, 16, 19, 22, 25, 28]


def test_no_go_ground_is_hatched(site):
    patches = survey_map(site.truth, area=site.area).axes[0].patches
    assert sum(bool(patch.get_hatch()) for patch in patches) == 1


def test_the_scale_bar_has_a_round_length(site):
    figure = survey_map(site.truth, area=site.area)
    assert {"20 m", "N"} <= set(texts(figure))


def test_an_area_in_another_crs_is_refused(site):
    elsewhere = SurveyArea.rectangle(site.area.bounds, "EPSG:32609")
    with pytest.raises(InputError, match="area"):
        survey_map(site.truth, area=elsewhere)


def test_compared_surfaces_share_their_colours(site):
    axes = terrain_comparison(site.truth, site.reconstruction, site.prior, area=site.area).axes[:3]
    limits = {image.get_clim() for panel in axes for image in rasters(panel)}
    shown = [site.truth.elevation, site.reconstruction.mean.elevation, site.prior.elevation]
    assert limits == {(min(map(np.nanmin, shown)), max(map(np.nanmax, shown)))}
    np.testing.assert_array_equal(rasters(axes[1])[0].get_array(), site.reconstruction.mean.elevation)
    np.testing.assert_array_equal(rasters(axes[2])[0].get_array(), site.prior.elevation)
    assert [panel.get_title(loc="left") for panel in axes] == [
        "Reference",
        "Reconstruction",
        "Prior, 25 m cells",
    ]


def test_without_a_prior_two_surfaces_are_compared(site):
    figure = terrain_comparison(site.truth, site.reconstruction)
    assert len([axes for axes in figure.axes if axes.get_xlabel() == "Easting [m]"]) == 2


def test_the_deviation_is_shown_inside_the_area_only(site):
    (image,) = rasters(deviation_map(site.reconstruction, area=site.area, route=site.route).axes[0])
    inside = site.area.contains(site.grid.xy).reshape(site.grid.shape)
    shown = np.ma.filled(image.get_array(), np.nan)
    np.testing.assert_array_equal(shown[inside], site.reconstruction.std.elevation[inside])
    assert np.isnan(shown[~inside]).all()
    assert image.get_clim()[0] == 0.0


def test_support_shares_count_the_area(site):
    figure = support_map(site.reconstruction, area=site.area)
    inside = site.area.contains(site.grid.xy)
    measured = np.mean(site.reconstruction.support.ravel()[inside] == 3)
    labels = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    assert labels == [
        "Unseen\n0%",
        f"Interpolated\n{1 - measured:.0%}",
        "Ray-bounded\n0%",
        f"Measured\n{measured:.0%}",
    ]


def test_every_landmark_is_counted_once(site):
    axes = landmark_map(site.points, site.truth, area=site.area, route=site.route).axes[0]
    assert axes.collections[0].get_array().sum() == len(site.points)
    np.testing.assert_array_equal(np.column_stack(axes.lines[0].get_data()), site.points.xy)


def test_the_same_map_gives_the_same_bytes(site):
    first, second = (png_bytes(survey_map(site.truth, area=site.area, route=site.route)) for _ in range(2))
    assert first == second
    assert first.startswith(b"\x89PNG")
    assert b"Software" not in first


def test_unknown_cells_do_not_spoil_the_shading(site):
    holes = site.truth.elevation.copy()
    holes[5:9, 5:9] = np.nan
    axes = survey_map(Dem(holes, site.truth.transform, site.truth.crs)).axes[0]
    shading = next(mesh.get_array() for mesh in meshes(axes) if mesh.get_array().ndim == 3)
    finer = shading.shape[0] // len(holes)
    clear = shading[..., 3] == 0
    assert clear[5 * finer : 9 * finer, 5 * finer : 9 * finer].all()
    assert not clear.all()


def test_flat_ground_can_be_drawn():
    grid = Grid((0.0, 0.0, 40.0, 20.0), 5.0)
    flat = Dem.on(grid, np.zeros(grid.shape))
    assert relief_exaggeration(flat) == 10.0
    assert png_bytes(survey_map(flat))


def test_large_rasters_are_thinned_in_place():
    grid = Grid((0.0, 0.0, 1600.0, 3.0), 1.0)
    dem = Dem.on(grid, grid.xy[:, 0].reshape(grid.shape))
    small = decimate(dem)
    assert small.shape == (2, 801)
    # Elevation is easting, so the kept cells must still lie where their values say.
    np.testing.assert_allclose(small.elevation[0], small.x, atol=1e-9)


@pytest.mark.parametrize(("width", "height"), [(800.0, 100.0), (100.0, 800.0), (300.0, 300.0)])
def test_strips_are_shown_with_room_on_both_sides(width, height):
    grid = Grid((0.0, 0.0, width, height), 50.0)
    xmin, ymin, xmax, ymax = view(Dem.on(grid, np.zeros(grid.shape)), None)
    assert 0.5 <= (ymax - ymin) / (xmax - xmin) <= 2.2 + 1e-12
    assert (xmin + xmax, ymin + ymax) == (width, height)


def test_limits_of_constant_surfaces_do_not_collapse():
    grid = Grid((0.0, 0.0, 2.0, 2.0), 1.0)
    limits = elevation_limits(Dem.on(grid, np.full(grid.shape, 7.0)))
    assert limits.vmin < limits.vmax
