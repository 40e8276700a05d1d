"""Reproduction of the papers' figures and tables: one study per figure, found by its name."""

import difflib
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from survey.core.arrays import Progress
from survey.core.errors import InputError


class Study(Protocol):
    """Produces one figure or table in a folder."""

    def __call__(self, folder: Path, *, quick: bool, progress: Progress) -> None:
        """Write pictures and tables into `folder`; `quick` makes them smaller and rougher."""


STUDIES: dict[str, str] = {
    "glacier-fig4": "papers.glacier.images:glacier_fig4",
    "glacier-fig5": "papers.glacier.terrain:glacier_fig5",
    "glacier-fig6": "papers.glacier.terrain:glacier_fig6",
    "glacier-fig7": "papers.glacier.terrain:glacier_fig7",
    "glacier-fig8": "papers.glacier.terrain:glacier_fig8",
    "glacier-tables": "papers.glacier.terrain:glacier_tables",
    "glacier-fig9": "papers.glacier.monte_carlo:glacier_fig9",
    "glacier-fig10": "papers.glacier.monte_carlo:glacier_fig10",
    "glacier-fig11": "papers.glacier.monte_carlo:glacier_fig11",
    "glacier-fig12": "papers.glacier.surveys:glacier_fig12",
    "glacier-fig13": "papers.glacier.surveys:glacier_fig13",
    "glacier-hyperparameters": "papers.glacier.hyperparameters:glacier_hyperparameters",
    "joint-map-comparison": "papers.glacier.joint_map:comparison",
    "emap-fig1": "papers.emap.figures:figure_1",
    "emap-fig2": "papers.emap.figures:figure_2",
    "emap-table1": "papers.emap.figures:table_1",
    "emap-fig4": "papers.emap.figures:figure_4",
    "emap-fig5": "papers.emap.figures:figure_5",
    "emap-fig6": "papers.emap.figures:figure_6",
    "emap-range": "papers.emap.figures:range_extension",
    "carving-fig3": "papers.carving.sine:figure_3",
    "carving-fig5": "papers.carving.sine:figure_5",
    "carving-table1": "papers.carving.bounds_and_timing:table_1",
    "carving-fig7": "papers.carving.maps:figure_7",
    "carving-fig8": "papers.carving.maps:figure_8",
    "carving-fig9": "papers.carving.maps:figure_9",
    "carving-fig10": "papers.carving.maps:figure_10",
    "carving-fig11": "papers.carving.bounds_and_timing:figure_11",
    "carving-fig12": "papers.carving.bounds_and_timing:figure_12",
    "carving-fig13": "papers.carving.maps:figure_13",
    "carving-algorithm1": "papers.carving.comparison:algorithm_1",
}
"""Study name → its function as ``module:function``, in the order of the papers."""

LONG: dict[str, str] = {
    "glacier-fig12": "ten surveys of about 2.7 km in images, about 25 minutes of CPU each; they continue where they were stopped",
    "glacier-fig13": "the same ten surveys, which are driven once",
}
"""Studies that take more than half an hour, and why."""


def study(name: str) -> Study:
    """Return the function of a study.

    Raises
    ------
    InputError
        There is no such study; the nearest name is given.
    """
    if name not in STUDIES:
        near = difflib.get_close_matches(name, STUDIES, n=1)
        hint = f"did you mean {near[0]}?" if near else "`firnline reproduce --list` names them all."
        raise InputError(f"there is no study {name!r}; {hint}")
    module, function = STUDIES[name].split(":")
    return cast("Study", getattr(import_module(module), function))
