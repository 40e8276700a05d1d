"""Run the command line: ``python -m firnline`` is the command ``firnline``."""

import os
import sys
from pathlib import Path

from firnline.guard import foreign_package


def main() -> None:
    """Run the command line, unless another module hides one of firnline's packages."""
    foreign = foreign_package()
    if foreign is not None:
        sys.stderr.write(foreign + "\n")
        raise SystemExit(1)
    try:
        name_cache()
        from firnline.cli.main import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("firnline: interrupted before any work started.\n")
        raise SystemExit(130) from None
    except (OSError, MemoryError, ImportError) as error:
        sys.stderr.write(
            f"firnline: cannot start ({error}); check the installation and the limits of the process (ulimit -a).\n"
        )
        raise SystemExit(3) from None


def name_cache(installation: Path = Path(__file__).parent) -> None:
    """Name the folder in which numba stores compiled loops, where it cannot store them in the installation.

    It is one of the user and of the version: numba does not notice that a function in another file has changed. Where the
    user has no folder either, loops are stored for this process and its children alone; numba would refuse to start.
    """
    if "NUMBA_CACHE_DIR" in os.environ or os.access(installation, os.W_OK):
        return
    from importlib.metadata import version

    try:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        place = caches / "firnline" / f"compiled-{version('firnline')}"
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # the latter where there is no home
        place = None
    if place is None or not os.access(place, os.W_OK):
        import atexit
        import shutil
        import tempfile

        place = Path(tempfile.mkdtemp(prefix="firnline-compiled-"))
        atexit.register(shutil.rmtree, place, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(place)


if __name__ == "__main__":
    main()
