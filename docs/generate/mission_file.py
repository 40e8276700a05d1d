"""Reference of mission files, from the configuration models."""

from generate.models import sections_text
from sim.config.mission import MissionConfig

_HEAD = """\
# Mission files

A mission file is TOML. `firnline init my-survey.toml` writes one with every setting, and `--set KEY=VALUE` overrides
one on the command line, as in `--set planner.swaths=6`. Lengths are metres, times seconds, angles degrees. Unknown
keys are refused with the nearest known one. Only `schema_version`, `name`, `terrain.source` and `planner.pattern`
are required; everything else has the default shown here.

Where one of several kinds can be chosen (`terrain`, `planner`), each kind has a table of its own.

"""


def pages() -> dict[str, str]:
    """Return the page of mission files."""
    return {"reference/mission-file.md": _HEAD + sections_text(MissionConfig)}
