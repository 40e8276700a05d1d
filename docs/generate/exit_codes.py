"""Reference of exit codes, from the topic of the command line and the classes of errors."""

from firnline.cli.guide import _EXIT_CODES
from generate.tables import code, table
from survey.core import errors

_HEAD = """\
# Exit codes

Every command ends with one of these codes, so that scripts can react. `firnline help exit-codes` prints them.

"""
_ERRORS = """
## Exceptions in Python

Refusals are subclasses of `FirnlineError`. Each message is one sentence: what was found, where, what was expected and
what to do.

"""


def pages() -> dict[str, str]:
    """Return the page of exit codes."""
    rows = [
        tuple(part.strip() for part in line.split(maxsplit=1)) for line in _EXIT_CODES.strip().splitlines()
    ]
    text = _HEAD + table(("code", "meaning"), [(code(number), meaning) for number, meaning in rows])
    return {
        "reference/exit-codes.md": text + _ERRORS + table(("exception", "exit code", "meaning"), error_rows())
    }


def error_rows() -> list[tuple[str, str, str]]:
    """Return the exceptions with their exit codes and first sentences."""
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    return [
        (code(kind.__name__), code(str(kind.exit_code)), (kind.__doc__ or "").split("\n\n")[0])
        for kind in kinds
    ]
