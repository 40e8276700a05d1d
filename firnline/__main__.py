"""Run the command line: ``python -m firnline`` is the command ``firnline``."""

import sys

from firnline.guard import foreign_package


def main() -> None:
    """Run the command line, unless another module hides one of firnline's packages."""
    foreign = foreign_package()
    if foreign is not None:
        sys.stderr.write(foreign + "\n")
        raise SystemExit(1)
    try:
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


if __name__ == "__main__":
    main()
