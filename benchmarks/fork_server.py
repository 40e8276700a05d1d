"""Start commands as processes that can be killed, without importing the packages again for each.

A server process imports everything once. It forks one child for each command line that it reads. The child
ends without the clean-up of the interpreter, which takes longer than a small command.
"""

import os
import select
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Self

_SERVER = """
import os, sys
import matplotlib.backends.backend_agg, pyarrow.parquet
import planners.planning, survey.figures, survey.reporting, vision_slam.pipeline
import firnline.actions.runs, firnline.actions.studies, sim.mission.report, sim.montecarlo.study
from firnline.cli.main import app
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        try:
            app(args=line.rstrip("\\n").split("\\t"))
        except SystemExit as ending:
            sys.stderr.flush()
            os._exit(ending.code or 0)
    print(child, flush=True)
    print(os.waitpid(child, 0)[1], flush=True)
"""


class ForkServer:
    """Server of child processes, one at a time; their standard output is discarded.

    Parameters
    ----------
    folder : pathlib.Path
        The current folder of all commands.
    """

    def __init__(self, folder: Path) -> None:
        roots = os.pathsep.join([str(Path(__file__).resolve().parents[1]), os.environ.get("PYTHONPATH", "")])
        self._process = subprocess.Popen(
            [sys.executable, "-c", _SERVER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": roots},
        )

    def __enter__(self) -> Self:
        """Return the server."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the server."""
        self._pipe(self._process.stdin).close()
        self._process.wait()
        self._pipe(self._process.stdout).close()

    def start(self, command: str) -> int:
        """Start a command, given by its arguments, and return its process id."""
        pipe = self._pipe(self._process.stdin)
        pipe.write("\t".join(command.split()) + "\n")
        pipe.flush()
        return self._number()

    def ended(self, within_s: float) -> int | None:
        """Return the command's exit status as of `os.waitpid`, or None when it still runs after so many seconds."""
        ready, _, _ = select.select([self._process.stdout], [], [], within_s)
        return self._number() if ready else None

    def killed(self, process: int) -> int | None:
        """Kill the command and return its exit status: 9, or another one when it ended before."""
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
        return self.ended(within_s=60.0)

    def run(self, command: str, within_s: float = 300.0) -> int | None:
        """Start a command and return its exit status."""
        self.start(command)
        return self.ended(within_s)

    def _number(self) -> int:
        return int(self._pipe(self._process.stdout).readline())

    @staticmethod
    def _pipe(pipe: IO[str] | None) -> IO[str]:
        assert pipe is not None
        return pipe
