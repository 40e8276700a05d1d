"""Job that follows the log of a watched survey: its events as they are written, and the map after each update."""

import json
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import Any

from pyproj import CRS

from desk.jobs.job import Job
from desk.runs.layers import layers_of
from firnline.cli.live.watch_lines import text_of
from live.watch.log import entered, watch_of
from live.watch.survey_watch import SurveyWatch
from survey.core.crs import same_crs
from survey.core.errors import InputError
from survey.data.dem import Dem

_POLL_S = 0.5


def watched(file: Path, crs: CRS, job: Job) -> dict[str, Any]:
    """Follow a log of ``firnline watch`` until the survey ends.

    Returns: a ``sentence`` about the end of the survey.
    """
    if not file.is_file():
        raise InputError(
            f"there is no log {file.name} beside the plan; start firnline watch with --log {file.name}."
        )
    text, watch = "", None
    for line in _lines(file, job):
        try:
            entry = json.loads(line)
            if watch is None:
                watch = watch_of(entry)
                same_crs(crs, watch.area.crs, "the desk and the survey")
            events = entered(watch, entry) if "in" in entry else []
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{file.name} is no log of firnline watch ({error}); name another one."
            ) from error
        for event in events:
            text = _reported(event, watch, job)
        if watch.is_stopped:
            break
    return {"sentence": text}


def _reported(event: dict[str, Any], watch: SurveyWatch, job: Job) -> str:
    """Report an event, and the map after an update."""
    text = text_of(event)
    job.report("watch", text=text, do=event.get("do", ""))
    if event["event"] == "map" and watch.latest_map is not None:
        n_swaths = sum(leg.kind == "swath" for leg in watch.progress.driven)
        of = sum(leg.kind == "swath" for leg in watch.legs)
        fields = (Dem.on(watch.grid, field) for field in watch.latest_map)
        job.report("grown", swaths=n_swaths, of=of, **layers_of(*fields))
    return text


def _lines(file: Path, job: Job) -> Iterator[str]:
    """Yield the complete lines of a file as it grows, until the job is given up."""
    with file.open(encoding="utf-8") as stream:
        part = ""
        while True:
            part += stream.readline()
            if part.endswith("\n"):
                yield part
                part = ""
            else:
                job.require_wanted()
                sleep(_POLL_S)
