"""Progress bars on stderr."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from survey.core.run_folder import STAGES
from survey.core.text import duration_text

_DOING = {
    "plan": "planning the route", "simulate": "driving and sensing",
    "localize": "estimating path and landmarks", "reconstruct": "reconstructing the terrain",
    "score": "scoring", "report": "drawing the report",
}  # fmt: skip


class TimeLeftColumn(ProgressColumn):
    """Column with the time that is left of a task, by the time that it took before."""

    def render(self, task: Task) -> Text:
        """Return the time left as text; nothing where none is known."""
        expected_s = task.fields.get("expected_s")
        if expected_s is None:
            return Text("")
        left_s = expected_s - (task.elapsed or 0.0)
        return Text(f"about {duration_text(left_s)} left" if left_s > 1.0 else "about to end")


class StageProgress:
    """Progress of the stages of a mission, for the `watch` of `run_mission`.

    `quiet`: print nothing. `expected_s`: time that each stage took in an earlier run of the mission [s].
    """

    def __init__(
        self, *, quiet: bool = False, expected_s: Mapping[str, float] = MappingProxyType({})
    ) -> None:
        self.seconds: dict[str, float] = {}
        self._expected_s = expected_s
        self._console = Console(stderr=True, quiet=quiet, highlight=False)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Show one stage."""
        number = f"{STAGES.index(stage) + 1}/{len(STAGES)}"
        began = time.perf_counter()
        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), TimeLeftColumn())
        with Progress(
            *columns, console=self._console, transient=True, disable=not self._console.is_terminal
        ) as bar:
            bar.add_task(f"{number} {_DOING[stage]} …", total=None, expected_s=self._expected_s.get(stage))
            yield
        self.seconds[stage] = time.perf_counter() - began
        self._console.print(f"{number} {stage:<12} {self.seconds[stage]:6.1f} s")


class RateColumn(ProgressColumn):
    """Column with the number of items per second."""

    def render(self, task: Task) -> Text:
        """Return the rate as text."""
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.3g}/s")


# Time between lines of progress where there is no terminal [s].
_LINE_EACH_S = 10.0


@contextmanager
def counted(*, quiet: bool = False) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a progress callback (what, done, total) that shows a bar for each kind of work.

    Without a terminal it prints a line at the first call, then one each ten seconds at most.
    """
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        RateColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True, quiet=quiet, highlight=False)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        tasks: dict[str, TaskID] = {}
        printed_s = time.perf_counter() - _LINE_EACH_S

        def update(what: str, done: int, total: int) -> None:
            nonlocal printed_s
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done, total=total)
            if not console.is_terminal and time.perf_counter() - printed_s >= _LINE_EACH_S:
                printed_s, left_s = time.perf_counter(), bars.tasks[tasks[what]].time_remaining
                left = "" if left_s is None else f", about {duration_text(left_s)} left"
                console.print(f"{what}: {done} of {total}{left}")

        yield update
