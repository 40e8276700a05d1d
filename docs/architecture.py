"""Draw the architecture picture of the README from the import graph: ``python docs/architecture.py``.

Each row is a layer of the import contract in ``pyproject.toml``; its packages import only from rows below it. A
package is drawn with its folders, those that import from others first, and with the number of its modules that import
from each other package. Arrows join packages of neighbouring rows.
"""

import tomllib
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import grimp
import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).resolve().parents[1]
PURPOSES = {
    "firnline": "command line and public names",
    "firnline.cli": "command line",
    "firnline.actions": "what commands and desk do: read, check, compute",
    "papers": "figures and tables of the papers",
    "desk": "planning desk in a browser",
    "live": "surveys while they are driven",
    "sim": "worlds, sensors, vehicles, missions",
    "planners": "routes, predicted errors",
    "vision_slam": "localization",
    "survey": "data types, formats, maps, scores, figures",
}
COLOURS = {
    "sim": "#d9e6f2",
    "planners": "#dcebdc",
    "vision_slam": "#dcebdc",
    "survey": "#e6e9ec",
}
"""Colour of a package's box; the others, which users call, share one."""
CALLED = "#f3e3c3"
INK, MUTED = "#1d2a35", "#55626d"
WIDTH, BETWEEN, GAP = 12.0, 0.4, 0.55
"""Width of a row, and the free space between boxes of a row and between rows, in units of 1.9 cm."""
TITLE, FOLDER, PADDING, WIDEST = 0.62, 0.46, 0.36, 2.6
"""Heights of a title and of a line of folders, room for the line of imports, and largest width of a folder."""


class Box(NamedTuple):
    """Place of a package in the picture."""

    left: float
    bottom: float
    width: float
    height: float


def folders(graph: grimp.ImportGraph, package: str) -> list[str]:
    """Return the folders of a package, those that import from others first, directly or through others."""
    children = [
        child
        for child in graph.find_children(package)
        if graph.find_children(child) and not child.rpartition(".")[2].startswith("_")
    ]
    used = {
        child: sum(
            graph.chain_exists(importer=child, imported=other, as_packages=True)
            for other in children
            if other != child
        )
        for child in children
    }
    return [child.rpartition(".")[2] for child in sorted(children, key=lambda child: (-used[child], child))]


def is_within(module: str, package: str) -> bool:
    """Return whether a module is a package or lies in it."""
    return f"{module}.".startswith(f"{package}.")


def n_importing(graph: grimp.ImportGraph, upper: str, lower: str) -> int:
    """Return how many modules of one package import from another."""
    return sum(
        any(is_within(found, lower) for found in graph.find_modules_directly_imported_by(module))
        for module in {upper, *graph.find_descendants(upper)}
    )


def columns_of(names: list[str], width: float) -> int:
    """Return how many folders fit beside one another, as evenly over the lines as they can."""
    if not names:
        return 1
    fitting = max(int((width - 0.3) / (0.105 * max(map(len, names)) + 0.4)), 1)
    n_lines = -(-len(names) // fitting)
    return -(-len(names) // n_lines)


def boxes(rows: list[list[str]], found: dict[str, list[str]]) -> dict[str, Box]:
    """Return the places of all packages, from the bottom row up."""
    placed, bottom = {}, 0.0
    for row in reversed(rows):
        width = (WIDTH - BETWEEN * (len(row) - 1)) / len(row)
        lines = max(-(-len(found[name]) // columns_of(found[name], width)) for name in row)
        height = TITLE + FOLDER * lines + PADDING
        for index, name in enumerate(row):
            placed[name] = Box(index * (width + BETWEEN), bottom, width, height)
        bottom += height + GAP
    return placed


def draw_box(axes: Axes, box: Box, colour: str) -> None:
    """Draw a rounded box."""
    style = "round,pad=0,rounding_size=0.12"
    place = (box.left, box.bottom)
    axes.add_patch(
        FancyBboxPatch(
            place, box.width, box.height, boxstyle=style, facecolor=colour, edgecolor=INK, linewidth=0.8
        )
    )


def draw_package(axes: Axes, package: str, box: Box, names: list[str], imports: dict[str, int]) -> None:
    """Draw a package with its folders and the packages that it imports from."""
    draw_box(axes, box, COLOURS.get(package, CALLED))
    top, right = box.bottom + box.height, box.left + box.width
    axes.text(box.left + 0.15, top - 0.31, package, weight="bold", va="center", color=INK)
    purpose = PURPOSES.get(package, "")
    axes.text(right - 0.15, top - 0.31, purpose, va="center", ha="right", color=INK, fontsize=9.0)
    columns = columns_of(names, box.width)
    cell = min((box.width - 0.3) / columns, WIDEST)
    for index, name in enumerate(names):
        row, column = divmod(index, columns)
        left, bottom = box.left + 0.15 + column * cell, top - TITLE - FOLDER * (row + 1) + 0.06
        draw_box(axes, Box(left + 0.05, bottom, cell - 0.1, FOLDER - 0.08), "white")
        axes.text(
            left + 0.5 * cell,
            bottom + 0.5 * FOLDER - 0.04,
            name,
            ha="center",
            va="center",
            fontsize=8.0,
            color=INK,
        )
    if imports:
        counted = " · ".join(f"{name} {n}" for name, n in imports.items())
        axes.text(
            box.left + 0.2,
            box.bottom + 0.2,
            f"imports {counted}",
            va="center",
            fontsize=7.0,
            color=MUTED,
        )


def draw_arrow(axes: Axes, upper: Box, lower: Box) -> None:
    """Draw an arrow from a package to one of the next row, in the middle of what they share of the width."""
    left = max(upper.left, lower.left)
    right = min(upper.left + upper.width, lower.left + lower.width)
    x = 0.5 * (left + right)
    tip, tail = (x, lower.bottom + lower.height), (x, upper.bottom)
    axes.annotate("", tip, tail, arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.0})


def draw() -> Figure:
    """Draw the architecture picture."""
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    rows = [[name.strip() for name in layer.split("|")] for layer in stated["contracts"][0]["layers"]]
    graph = grimp.build_graph(*stated["root_packages"], cache_dir=None)
    packages = [name for row in rows for name in row]
    found = {name: folders(graph, name) for name in packages}
    places = boxes(rows, found)
    height = max(box.bottom + box.height for box in places.values())
    figure = Figure(figsize=(9.0, 9.0 * (height + 0.2) / (WIDTH + 0.2)), layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(-0.1, WIDTH + 0.1), ylim=(-0.1, height + 0.1))
    axes.axis("off")
    for name in packages:
        # Packages of the same row do not import one another; those above are left out.
        below = [other for row in rows[level_of(rows, name) + 1 :] for other in row]
        imports = {other: n for other in below if (n := n_importing(graph, name, other))}
        draw_package(axes, name, places[name], found[name], imports)
    for upper_row, lower_row in pairwise(rows):
        for upper in upper_row:
            for lower in lower_row:
                if n_importing(graph, upper, lower) and shares_width(places[upper], places[lower]):
                    draw_arrow(axes, places[upper], places[lower])
    return figure


def level_of(rows: list[list[str]], package: str) -> int:
    """Return the row of a package, counted from the top."""
    return next(level for level, row in enumerate(rows) if package in row)


def shares_width(upper: Box, lower: Box) -> bool:
    """Return whether one box stands above another."""
    return upper.left < lower.left + lower.width and lower.left < upper.left + upper.width


if __name__ == "__main__":
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "firnline", "font.family": "DejaVu Sans"}):
        draw().savefig(ROOT / "docs" / "images" / "architecture.svg", metadata={"Date": None})
