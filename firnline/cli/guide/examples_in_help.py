"""Examples in the help of commands, each on one line, so that it can be pasted."""

import inspect
from collections.abc import Callable
from typing import Any

# click neither joins nor breaks the lines of a paragraph that begins with this mark.
_UNBROKEN = "\b"


def help_of(command: Callable[..., Any]) -> str:
    """Return the docstring of a command as its help, with examples that are not broken at the terminal's width."""
    paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")
    return "\n\n".join(_UNBROKEN + "\n" + one if _is_example(one) else one for one in paragraphs)


def _is_example(paragraph: str) -> bool:
    return paragraph.startswith("  firnline ") and "\n" not in paragraph
