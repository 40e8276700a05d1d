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
    "glacier-fig4": "sim.studies.glacier.images:glacier_fig4",
    "glacier-fig5": "sim.studies.glacier.terrain:glacier_fig5",
    "glacier-fig6": "sim.studies.glacier.terrain:glacier_fig6",
    "glacier-fig7": "sim.studies.glacier.terrain:glacier_fig7",
    "glacier-fig8": "sim.studies.glacier.terrain:glacier_fig8",
    "glacier-tables": "sim.studies.glacier.terrain:glacier_tables",
    "glacier-fig9": "sim.studies.glacier.monte_carlo:glacier_fig9",
    "glacier-fig10": "sim.studies.glacier.monte_carlo:glacier_fig10",
    "glacier-fig11": "sim.studies.glacier.monte_carlo:glacier_fig11",
    "glacier-fig12": "sim.studies.glacier.surveys:glacier_fig12",
    "glacier-fig13": "sim.studies.glacier.surveys:glacier_fig13",
    "glacier-hyperparameters": "sim.studies.glacier.hyperparameters:glacier_hyperparameters",
    "joint-map-comparison": "sim.studies.glacier.joint_map:comparison",
    "emap-fig1": "sim.studies.emap.figures:figure_1",
    "emap-fig2": "sim.studies.emap.figures:figure_2",
    "emap-table1": "sim.studies.emap.figures:table_1",
    "emap-fig4": "sim.studies.emap.figures:figure_4",
    "emap-fig5": "sim.studies.emap.figures:figure_5",
    "emap-fig6": "sim.studies.emap.figures:figure_6",
    "emap-range": "sim.studies.emap.figures:range_extension",
    "carving-fig3": "sim.studies.carving.sine:figure_3",
    "carving-fig5": "sim.studies.carving.sine:figure_5",
    "carving-table1": "sim.studies.carving.bounds_and_timing:table_1",
    "carving-fig7": "sim.studies.carving.maps:figure_7",
    "carving-fig8": "sim.studies.carving.maps:figure_8",
    "carving-fig9": "sim.studies.carving.maps:figure_9",
    "carving-fig10": "sim.studies.carving.maps:figure_10",
    "carving-fig11": "sim.studies.carving.bounds_and_timing:figure_11",
    "carving-fig12": "sim.studies.carving.bounds_and_timing:figure_12",
    "carving-fig13": "sim.studies.carving.maps:figure_13",
    "carving-algorithm1": "sim.studies.carving.comparison:algorithm_1",
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
