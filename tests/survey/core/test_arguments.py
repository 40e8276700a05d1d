"""Types of arguments are checked against annotations."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest

from survey.core.arguments import check_types


@check_types
def example(
    path: str | Path,
    share: Annotated[float, "between 0 and 1"] = 0.5,
    kind: Literal["a", "b"] = "a",
    *,
    count: int | None = None,
    progress: Callable[[str], None] | None = None,
    anything: Any = None,
) -> str:
    return f"{path} {share} {kind} {count} {anything}"


def test_right_types_pass_and_numpy_numbers_count_as_numbers():
    assert example(Path("a"), 1, count=np.int64(3)) == "a 1 a 3 None"
    assert example("a", np.float32(0.5), progress=print, anything=object).startswith("a 0.5")


@pytest.mark.parametrize(
    ("arguments", "settings", "message"),
    [
        ((3,), {}, r"example\(\) was given an int for 'path'; a str or a Path was expected\."),
        (("a", "b"), {}, r"a str for 'share'; a float was expected\."),
        (("a",), {"count": 1.5}, r"a float for 'count'; an int or None was expected\."),
    ],
)
def test_wrong_types_are_named_with_what_was_expected(arguments, settings, message):
    with pytest.raises(TypeError, match=message):
        example(*arguments, **settings)


def test_the_signature_and_the_docstring_stay():
    assert example.__name__ == "example"
    assert example.__wrapped__.__annotations__["share"] == Annotated[float, "between 0 and 1"]
