"""Scripts run by the code of commit e7dc4dd, in a checkout with an environment of its own."""

import json
import os
import subprocess
from pathlib import Path

CHECKOUT = os.environ.get("FIRNLINE_EARLIER")
"""Folder of the checkout, with ``.venv`` in it; without it stored outcomes are read, if there are any."""


def facts_of(script: str, *words: str) -> dict[str, float]:
    """Run a script with the earlier code; return the JSON object of its last line."""
    checkout = Path(str(CHECKOUT))
    command = [str(checkout / ".venv" / "bin" / "python"), "-c", script, *words]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    done = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, text=True, cwd=checkout, env=environment
    )
    facts: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return facts
