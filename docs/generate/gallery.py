"""Pictures of the gallery: figures that a script holds in variables, whether pyplot knows them or not."""

from typing import Any

from matplotlib import pyplot
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

DPI = 110
SECTIONS = [f"../examples/gallery/{name}" for name in ("planning", "terrain", "drives", "maps", "accuracy")]
"""Folders of the scripts, in the order of the pages."""


class FigureScraper:
    """Save the figures of a script in the order of their variables."""

    def __call__(self, _block: Any, block_vars: dict[str, Any], conf: dict[str, Any]) -> str:
        """Return reST that shows the figures made by a block."""
        found = {
            id(value): value for value in block_vars["example_globals"].values() if isinstance(value, Figure)
        }
        found |= {id(figure): figure for figure in map(pyplot.figure, pyplot.get_fignums())}
        images = []
        for figure in found.values():
            if getattr(figure, "is_shown", False):
                continue
            path = next(block_vars["image_path_iterator"])
            figure.savefig(path, dpi=DPI, bbox_inches="tight", metadata={"Software": None})
            figure.is_shown = True
            images.append(path)
        pyplot.close("all")
        return figure_rst(images, conf["src_dir"])

    def __repr__(self) -> str:
        """Return a name without an address, so that an unchanged configuration is seen as unchanged."""
        return "FigureScraper()"
