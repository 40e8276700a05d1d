"""All pages are accessible, fit a phone and print in few pages, as seen by a browser.

Needs Chromium, and axe-core outside the project: ``npm install axe-core`` and
``FIRNLINE_AXE=node_modules/axe-core/axe.min.js``.
"""

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.small_inputs import IDEAL_MISSION
from sim.cli.main import app
from tests.docs.scratch import make_scratch

AXE = Path(os.environ.get("FIRNLINE_AXE", "missing"))
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
MOST_PRINTED = 10
STUDY = """
schema_version = 1
name = "study"
trials = 2
swaths = [3, 5]
[[terrains]]
name = "hills"
source = "random"
family = "squared-exponential"
length_scale_m = 100.0
[[planners]]
pattern = "lawnmower"
"""
PROBE = """<script>
window.addEventListener("load", () => axe.run(document).then(found => {
  const panning = [...document.querySelectorAll("figure, figure > :not(figcaption)")]
    .filter(e => e.scrollWidth > e.clientWidth + 1);
  const shown = [...document.querySelectorAll("img")].map(e => 1.0 * e.clientWidth / e.naturalWidth);
  parent.postMessage(JSON.stringify({
    violations: found.violations.map(v => v.id + ": " + v.nodes[0].html.slice(0, 120)),
    width: document.documentElement.scrollWidth,
    panning: panning.map(e => e.outerHTML.slice(0, 80)),
    smallest: Math.min(...shown),
  }), "*");
}));
</script></body>"""
# A window of Chromium is at least 500 pixels wide; a frame within it can be as narrow as a phone.
FRAME = """<!DOCTYPE html><html><body><iframe src="probed.html" width="{width}" height="900"></iframe><script>
window.addEventListener("message", event => {{
  const note = document.createElement("pre");
  note.id = "found-by-axe";
  note.textContent = event.data;
  document.body.append(note);
}});
</script></body></html>"""
# Figures have 240 pixels per inch; at less than 0.33 of that, letters of 8 points are less than 9 pixels tall.
LEAST_SHOWN = 0.33

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed"),
    pytest.mark.skipif(not AXE.is_file(), reason="FIRNLINE_AXE does not name axe.min.js"),
]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Pages of a run, a score, a change and a study."""
    folder = tmp_path_factory.mktemp("pages")
    make_scratch(folder)
    (folder / "mission.toml").write_text(IDEAL_MISSION)
    (folder / "study.toml").write_text(STUDY)
    checkpoints = ["--checkpoints", "gnss.csv", "--class", "0.10", "--by", "slope", "--language", "de"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        firnline("run", "mission.toml", "--runs", "runs", "-q")
        firnline("montecarlo", "study.toml", "--runs", "studies", "--engine", "serial", "-q")
        firnline("score", "map.tif", *checkpoints, "--report", "score")
        firnline(
            "change", "2026.tif", "2024.tif", "--outline", "glacier.gpkg", "-o", "c", "--report", "change"
        )
    return {
        "run": next(folder.glob("runs/small/*/6-report/index.html")),
        "montecarlo": next(folder.glob("studies/study/**/index.html")),
        "score": folder / "score" / "index.html",
        "change": folder / "change" / "index.html",
    }


def firnline(*args: str) -> None:
    done = CliRunner().invoke(app, list(args))
    assert done.exit_code == 0, done.output


def browser(*args: str) -> str:
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", *args]
    return subprocess.run(command, check=True, capture_output=True, timeout=120, text=True).stdout


@pytest.mark.parametrize("name", ["run", "montecarlo", "score", "change"])
@pytest.mark.parametrize("width_px", [390, 1280])
def test_a_page_has_no_violation_and_is_legible_without_scrolling_sideways(
    pages: dict[str, Path], tmp_path: Path, name: str, width_px: int
) -> None:
    text = pages[name].read_text(encoding="utf-8")
    probed = re.sub(r"<meta http-equiv=\"Content-Security-Policy\"[^>]*>", "", text)
    probed = probed.replace("</body>", f"<script>{AXE.read_text(encoding='utf-8')}</script>{PROBE}")
    (tmp_path / "probed.html").write_text(probed, encoding="utf-8")
    (tmp_path / "frame.html").write_text(FRAME.format(width=width_px), encoding="utf-8")
    url = (tmp_path / "frame.html").as_uri()
    dom = browser("--window-size=1400,1000", "--virtual-time-budget=20000", "--dump-dom", url)
    found = json.loads(html.unescape(re.search(r'<pre id="found-by-axe">(.*?)</pre>', dom, re.S)[1]))
    assert found["violations"] == []
    assert found["width"] <= width_px
    assert found["panning"] == []
    assert found["smallest"] >= LEAST_SHOWN


@pytest.mark.parametrize("name", ["run", "montecarlo", "score", "change"])
def test_a_page_prints_on_few_sheets_without_its_settings(
    pages: dict[str, Path], tmp_path: Path, name: str
) -> None:
    browser("--no-pdf-header-footer", f"--print-to-pdf={tmp_path / 'p.pdf'}", pages[name].as_uri())
    n_pages = len(re.findall(rb"/Type\s*/Page[^s]", (tmp_path / "p.pdf").read_bytes()))
    assert 1 <= n_pages <= MOST_PRINTED
