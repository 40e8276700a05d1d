"""Draw the architecture picture of the README from the import graph: ``python docs/architecture.py``.

Each box is a folder; a folder imports only from folders below it. Arrows join packages and state how
many modules of the upper one import from the lower one.
"""

from pathlib import Path

import grimp
import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "firnline": ("public", (0.0, 8.6, 2.5, 0.65)),
    "papers": ("figures and tables", (0.0, 7.2, 2.5, 1.2)),
    "desk": ("page to draw a plan", (6.5, 7.5, 5.5, 1.2)),
    "live": ("surveys while driven", (2.8, 7.5, 3.4, 1.75)),
    "sim": ("worlds, sensors, missions", (0.0, 5.0, 12.0, 1.75)),
    "planners": ("routes", (0.0, 2.5, 5.5, 1.75)),
    "vision_slam": ("localization", (6.5, 2.5, 5.5, 1.75)),
    "survey": ("data types, formats, maps, scores, figures", (0.0, 0.0, 12.0, 1.75)),
}
"""Purpose of each package, and left, bottom, width and height of its box."""
COLOURS = {
    "firnline": "#f3e3c3",
    "papers": "#f3e3c3",
    "desk": "#f3e3c3",
    "live": "#f3e3c3",
    "sim": "#d9e6f2",
    "planners": "#dcebdc",
    "vision_slam": "#dcebdc",
    "survey": "#e6e9ec",
}
PER_ROW = {
    "firnline": 1,
    "papers": 3,
    "desk": 4,
    "live": 2,
    "sim": 5,
    "survey": 5,
    "planners": 4,
    "vision_slam": 4,
}
INK = "#1d2a35"


def folders(graph: grimp.ImportGraph, package: str) -> list[str]:
    """Return the folders of a package, those that import from others first."""
    children = [
        child
        for child in graph.find_children(package)
        if graph.find_children(child) and not child.rpartition(".")[2].startswith("_")
    ]
    used = {
        child: sum(
            graph.direct_import_exists(importer=child, imported=other, as_packages=True)
            for other in children
            if other != child
        )
        for child in children
    }
    return [child.rpartition(".")[2] for child in sorted(children, key=lambda child: (-used[child], child))]


def n_importing(graph: grimp.ImportGraph, upper: str, lower: str) -> int:
    """Return how many modules of one package import from another."""
    modules = {upper, *graph.find_descendants(upper)}
    return sum(
        any(found.split(".")[0] == lower for found in graph.find_modules_directly_imported_by(module))
        for module in modules
    )


def draw_box(axes: Axes, place: tuple[float, float, float, float], colour: str) -> None:
    """Draw a rounded box."""
    left, bottom, width, height = place
    style = "round,pad=0,rounding_size=0.12"
    axes.add_patch(
        FancyBboxPatch(
            (left, bottom), width, height, boxstyle=style, facecolor=colour, edgecolor=INK, linewidth=0.8
        )
    )


def draw_package(axes: Axes, graph: grimp.ImportGraph, package: str) -> None:
    """Draw a package with its folders."""
    purpose, (left, bottom, width, height) = PACKAGES[package]
    draw_box(axes, (left, bottom, width, height), COLOURS[package])
    axes.text(left + 0.15, bottom + height - 0.32, package, weight="bold", va="center", color=INK)
    axes.text(left + width - 0.15, bottom + height - 0.32, purpose, va="center", ha="right", color=INK)
    columns = PER_ROW.get(package, 1)
    cell = (width - 0.3) / columns
    for index, name in enumerate(folders(graph, package)):
        row, column = divmod(index, columns)
        x, y = left + 0.15 + column * cell, bottom + height - 1.05 - 0.5 * row
        draw_box(axes, (x + 0.05, y, cell - 0.1, 0.4), "white")
        axes.text(x + 0.5 * cell, y + 0.2, name, ha="center", va="center", fontsize=8.0, color=INK)


def draw_arrow(axes: Axes, graph: grimp.ImportGraph, upper: str, lower: str, x: float) -> None:
    """Draw an arrow from a package to the one that it imports from."""
    top, bottom = PACKAGES[upper][1][1], sum(PACKAGES[lower][1][1::2])
    axes.annotate("", (x, bottom), (x, top), arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.0})
    words = f"{n_importing(graph, upper, lower)} modules"
    axes.text(x + 0.12, bottom + 0.4, words, va="center", fontsize=8.0, color=INK)


def draw() -> Figure:
    """Draw the architecture picture."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(-0.1, 12.1), ylim=(-0.1, 9.35))
    axes.axis("off")
    for package in PACKAGES:
        draw_package(axes, graph, package)
    for upper, lower, x in (
        ("papers", "sim", 1.0),
        ("live", "sim", 4.3),
        ("desk", "sim", 9.0),
        ("sim", "planners", 2.0),
        ("sim", "vision_slam", 9.0),
        ("planners", "survey", 2.0),
        ("vision_slam", "survey", 9.0),
        ("sim", "survey", 6.0),
    ):
        draw_arrow(axes, graph, upper, lower, x)
    return figure


if __name__ == "__main__":
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "firnline", "font.family": "DejaVu Sans"}):
        draw().savefig(ROOT / "docs" / "images" / "architecture.svg", metadata={"Date": None})
