"""Reference of study files of the Monte Carlo, from the configuration models."""

from generate.models import sections_text
from sim.montecarlo.config import StudyConfig

_HEAD = """\
# Study files

`firnline montecarlo study.toml` reads a study file: kinds of terrain, planners, numbers of swaths, reconstructions and
a seed. `firnline example montecarlo_fig10` copies one. Planners are written as in a
[mission file](mission-file.md); those without a number of swaths are tried at every number of `swaths`.

"""


def pages() -> dict[str, str]:
    """Return the page of study files."""
    return {"reference/study-file.md": _HEAD + sections_text(StudyConfig)}
