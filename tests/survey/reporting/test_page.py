"""The page: self-contained, the same each time, honest in words, safe whatever the text."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from survey import Dem
from survey.core.errors import InputError
from survey.reporting.page import _write, deviation_caption, write_report
from survey.reporting.rendering import animation_of
from survey.reporting.survey_results import SurveyResults

FIGURES = {
    "map", "terrain", "std", "support", "landmarks", "error", "profile", "calibration", "histogram", "distance", "trajectory", "path", "path_error",
}  # fmt: skip
TITLE = "Ridge <script>alert(1)</script> & co"
CONFIG = "[planner]\nswaths = 4  # a < b\n"


class Outline(HTMLParser):
    """Collects tags with attributes."""

    def __init__(self, page):
        super().__init__()
        self.tags = []
        self.open = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "source"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def all(self, name):
        return [attributes for tag, attributes in self.tags if tag == name]


def surveyed(site, scored):
    return SurveyResults(
        area=site.area,
        prior=site.prior,
        truth=site.truth,
        route=site.route,
        reconstruction=site.reconstruction,
        score=scored,
        trajectory=site.trajectory,
        reference_trajectory=site.reference_trajectory,
        points=site.points,
    )


def write(folder, survey):
    return write_report(
        folder,
        survey,
        title=TITLE,
        localization={"ate_rmse_m": 0.3123, "n_loops": 2},
        config_text=CONFIG,
        provenance={"numpy": "2.4.6", "Seed": "7"},
    )


@pytest.fixture(scope="module")
def report(tmp_path_factory, site, scored):
    return write(tmp_path_factory.mktemp("run") / "6-report", surveyed(site, scored))


@pytest.fixture(scope="module")
def page(report):
    # Units stand behind a space that does not break.
    return report.read_text(encoding="utf-8").replace("\u00a0", " ")


def test_all_figures_lie_beside_the_page(report):
    assert report.name == "index.html"
    assert {path.stem for path in (report.parent / "figures").iterdir()} == FIGURES
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in (report.parent / "figures").iterdir())


def test_the_page_loads_nothing(page):
    outline = Outline(page)
    images = outline.all("img")
    assert len(images) == len(FIGURES)
    assert all(image["src"].startswith("data:image/webp;base64,") and image["alt"] for image in images)
    assert all(source["srcset"].startswith("data:image/webp;base64,") for source in outline.all("source"))
    assert not {"script", "link", "iframe", "object", "video"} & {tag for tag, _ in outline.tags}
    assert not re.search(r"https?://|url\(|@import", page)


def test_the_page_is_well_formed(page):
    outline = Outline(page)
    assert outline.open == []
    assert len(outline.all("h1")) == 1
    assert all("scope" in header for header in outline.all("th"))


def test_the_page_stays_small(report):
    # The limit for pages of 600 × 600 m is 4 MB; this site is a third as wide.
    assert report.stat().st_size < 4_000_000


def test_text_is_escaped(page):
    assert "<script" not in page
    assert "Ridge &lt;script&gt;alert(1)&lt;/script&gt; &amp; co" in page
    assert "a &lt; b" in page


def test_the_verdict_comes_first_and_names_the_standard(page, scored):
    verdict = scored.verdicts[0]
    body = page[page.index("<body>") :]
    assert body.index("Met") < body.index("<img")
    assert "Class 3 of ASPRS 1990 as read in the glacier paper" in page
    assert verdict.note in page
    assert f"its RMSE is {verdict.rmse_m:.3f} m, the limit {verdict.limit_m:.3f} m" in page


def test_results_settings_and_provenance_are_shown(page):
    for text in (
        "ATE RMSE",
        "0.312 m",
        "Loops",
        "length_scale_m",
        "matern-5/2",
        "numpy",
        "2.4.6",
        "EGM96",
        "swaths = 4",
    ):
        assert text in page


@pytest.mark.long
def test_the_same_survey_gives_the_same_bytes(report, tmp_path, site, scored):
    again = write(tmp_path / "again", surveyed(site, scored))
    assert again.read_bytes() == report.read_bytes()
    for path in (report.parent / "figures").iterdir():
        assert path.read_bytes() == (again.parent / "figures" / path.name).read_bytes()


def test_what_was_not_given_is_left_out(tmp_path, site, scored):
    bare = replace(
        surveyed(site, scored), prior=None, trajectory=None, reference_trajectory=None, points=None
    )
    page = write_report(tmp_path / "report", bare, title=TITLE)
    figures = {path.stem for path in (page.parent / "figures").iterdir()}
    assert figures == FIGURES - {"trajectory", "path", "path_error", "landmarks"}
    assert "Localization" not in page.read_text(encoding="utf-8")


def test_a_video_is_shown_at_its_own_size():
    video = BytesIO()
    images = [Image.new("RGB", (40, 30), (grey, grey, grey)) for grey in (0, 120, 240)]
    images[0].save(video, "WEBP", save_all=True, append_images=images[1:])
    picture = animation_of(video.getvalue(), "images of a drive", "Images of the camera.")
    assert picture.shown.size == (40, 30)
    assert picture.shown.source == picture.file_source
    assert picture.file_source.startswith("data:image/webp;base64,")


def test_a_folder_without_parent_is_refused(tmp_path, site, scored):
    with pytest.raises(InputError, match="no parent folder"):
        write(tmp_path / "missing" / "report", surveyed(site, scored))


def test_a_file_in_the_way_is_refused_and_left_alone(tmp_path):
    blocked = tmp_path / "report"
    blocked.write_text("in the way")
    with pytest.raises(InputError, match="could not be made"):
        _write(blocked, "<p>page</p>", {})
    assert blocked.read_text() == "in the way"


def test_deviations_are_called_small_along_the_swaths_only_where_they_are(site):
    assert "swaths" not in deviation_caption(site.reconstruction, site.route)
    xy = site.grid.xy
    far = np.min([np.hypot(*(xy - place).T) for leg in site.route.legs for place in leg.xy], axis=0)
    for rover in range(site.route.n_rovers):
        driven = site.route.sample(5.0, rover).xy
        far = np.minimum(far, np.min(np.hypot(*(xy[:, None] - driven[None]).T), axis=0))
    std = Dem.on(site.grid, 0.05 + 0.01 * far.reshape(site.grid.shape))
    assert "small along the swaths" in deviation_caption(replace(site.reconstruction, std=std), site.route)
