"""Arrays of the data types are read-only, of the stated shape, and finite."""

import numpy as np
import pytest

from survey import InputError
from survey.core.arrays import checked, frozen


def test_a_frozen_copy_does_not_follow_its_source() -> None:
    source = np.zeros(3)
    copy = frozen(source)
    source[0] = 1.0
    assert copy[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 2.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([[1.0, 2.0, 3.0]], r"shape \(1, 3\); \(N, 2\) was expected"),
        ([1.0, 2.0], r"shape \(2,\)"),
        ([[1.0, np.nan]], "1 values that are NaN"),
        ([[1.0, np.inf]], "infinite"),
        ([["a", "b"]], "no numbers|not numbers"),
    ],
)
def test_other_shapes_and_values_are_refused(values: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        checked(values, (None, 2), "the places")
