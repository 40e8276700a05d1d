"""What is seen of the planning desk: texts that are cut and boxes that overlap, in its states and on three screens."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

SIZES = ((1280, 800), (1920, 1080), (390, 844))
LONG_NAMES = (
    "Gletschermassenbilanzvermessungskampagne Großer Aletschgletscher, Frühjahr",
    "乌鲁木齐河源一号冰川东支二零二六年春季测绘任务第二次测量",
)
_FAULTS = """() => {
  const isShown = (one) => one.checkVisibility({ visibilityProperty: true, opacityProperty: true }) && !one.closest(".hidden, .skip, option");
  const name = (one) => `${one.tagName.toLowerCase()}${one.id ? "#" + one.id : ""}${one.className && typeof one.className === "string" ? "." + one.className.split(" ")[0] : ""}`;
  const clipped = (box, one) => {
    let { left, top, right, bottom } = box, cut = left < -1 || right > innerWidth + 1;
    for (let outer = one; outer && outer !== document.body; outer = outer.parentElement) {
      const { overflowX, overflowY } = getComputedStyle(outer), frame = outer.getBoundingClientRect();
      const fits = right <= frame.right + 1.5 && left >= frame.left - 1.5;
      if (overflowX !== "visible" && !fits && !outer.matches("#tools, .command")) cut = true;
      if (["hidden", "clip"].includes(overflowY) && (bottom > frame.bottom + 2.5 || top < frame.top - 2.5)) cut = true;
      if (overflowY !== "visible" || overflowX !== "visible") {
        left = Math.max(left, frame.left); right = Math.min(right, frame.right);
        top = Math.max(top, frame.top); bottom = Math.min(bottom, frame.bottom);
      }
    }
    return { left, top, right, bottom, cut };
  };
  const faults = [], texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const one = node.parentElement, text = node.textContent.trim();
    if (!text || !isShown(one) || one.closest("svg, script")) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const box of range.getClientRects()) {
      const seen = clipped(box, one);
      if (seen.cut) faults.push(`cut: ${name(one)} ${text.slice(0, 60)}`);
      if (seen.right - seen.left > 2 && seen.bottom - seen.top > 2) texts.push({ one, text, ...seen });
    }
  }
  for (const one of document.querySelectorAll("input[type=text], input[type=number], textarea, button"))
    if (isShown(one) && one.scrollWidth > one.clientWidth + 2) faults.push(`cut: ${name(one)} ${(one.value || one.textContent).slice(0, 60)}`);
  const cards = [...document.querySelectorAll("#tools, #hint, #notice, #layers, #legend > *, #readout > span, #drive, #panel")].filter((one) => isShown(one) && (one.textContent.trim() || one.id === "tools"));
  for (const one of cards) {
    const seen = clipped(one.getBoundingClientRect(), one.parentElement);
    if (seen.bottom - seen.top > 2 && seen.right - seen.left > 2) texts.push({ one, text: "", ...seen });
  }
  for (const [k, a] of texts.entries())
    for (const b of texts.slice(k + 1)) {
      const width = Math.min(a.right, b.right) - Math.max(a.left, b.left), height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (width < 2.5 || height < 2.5 || a.one === b.one || a.one.contains(b.one) || b.one.contains(a.one)) continue;
      // A text lies on a card only where the card is not below it: inside one card the texts alone are compared.
      faults.push(`overlap: ${name(a.one)} ${a.text.slice(0, 30)} | ${name(b.one)} ${b.text.slice(0, 30)}`);
    }
  return [...new Set(faults)];
}"""


def faults(page: Any) -> list[str]:
    """Return the texts that are cut and the boxes that overlap in a page as it stands."""
    found: list[str] = page.evaluate(_FAULTS)
    return found


def states(page: Any, raster: Path) -> Iterator[str]:
    """Bring the page of a desk into its main states, with long names in the data, and yield the name of each.

    `page`: open, of a plan that can be computed. `raster`: elevations over the same ground, in the CRS of the desk.
    """
    page.route("**/api/runs", lambda route: route.fulfill(json={"runs": _runs()}))
    for name, arrange in _STATES.items():
        arrange(page, raster)
        page.wait_for_timeout(250)
        yield name


def _survey(page: Any, _: Path) -> None:
    page.click("#tab-settings")
    _open_details(page, "settings")


def _shapes(page: Any, _: Path) -> None:
    page.click("#tab-shapes")
    _open_details(page, "shapes")
    page.click("[data-tool=area]")


def _require(page: Any, _: Path) -> None:
    page.click("[data-tool=select]")
    page.click("#tab-require")
    _open_details(page, "require")


def _compare(page: Any, _: Path) -> None:
    page.click("#tab-compare")
    for name in LONG_NAMES:
        page.fill("#variant-name", name)
        page.click("#add-variant")
        page.wait_for_selector(f"#variants >> text={name}")
    page.fill("#notes", " ".join(LONG_NAMES))
    page.click("#variants button >> nth=0")
    page.wait_for_selector("#differences table")
    page.click("#start-curve")
    page.wait_for_selector("#start-curve:not([disabled])")


def _run(page: Any, _: Path) -> None:
    page.click("#end-beside") if page.is_visible("#end-beside") else None
    page.click("#tab-runs")
    for box in page.locator(".run input").all():
        box.check()


def _measure(page: Any, _: Path) -> None:
    page.click("#tab-measured")


def _drive(page: Any, _: Path) -> None:
    page.click("#tab-watch")
    page.evaluate("document.getElementById('show-drive').click()")
    page.wait_for_selector("#drive .curve")


def _files(page: Any, raster: Path) -> None:
    page.evaluate("document.getElementById('show-drive').click()")
    page.click("#tab-files")
    for name in LONG_NAMES:
        page.set_input_files(
            "#open-file", {"name": f"{name}.tif", "mimeType": "image/tiff", "buffer": raster.read_bytes()}
        )
        page.click("#raster-kind button[value=elevations]")
        page.wait_for_selector(f".layer >> text={name}.tif", state="attached")


def _open_details(page: Any, tab: str) -> None:
    page.evaluate(
        "(id) => { for (const one of document.querySelectorAll(`#page-${id} details`)) one.open = true; }",
        tab,
    )


def _runs() -> list[dict[str, Any]]:
    facts = {"RMSE": "0.123 m", "Driven": "12.3 km", "Class": f"meets class 1 of {LONG_NAMES[0]}"}
    return [
        {"name": f"run-{k}", "title": name, "facts": facts, "folder": "/", "has_report": True}
        for k, name in enumerate(LONG_NAMES)
    ]


_STATES: dict[str, Callable[[Any, Path], None]] = {
    "survey": _survey, "shapes": _shapes, "require": _require, "compare": _compare, "run": _run,
    "measure": _measure, "drive": _drive, "files": _files,
}  # fmt: skip
