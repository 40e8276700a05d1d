"""Base class of the data types: equality, representation, pickling, copying."""

import copy
import pickle
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pytest

from survey.core.arrays import DataObject, ReadOnlyMapping, frozen


@dataclass(frozen=True, eq=False, repr=False)
class Profile(DataObject):
    height_m: np.ndarray
    values: ReadOnlyMapping = field(default_factory=lambda: ReadOnlyMapping({}))

    @cached_property
    def doubled(self):
        return 2.0 * self.height_m


def profile(*heights):
    return Profile(frozen(heights), ReadOnlyMapping({"slope_deg": frozen(heights)}))


def test_arrays_are_compared_element_by_element_and_nan_equals_nan():
    assert profile(1.0, np.nan) == profile(1.0, np.nan)
    assert profile(1.0, 2.0) != profile(1.0, 3.0)
    assert profile(1.0) != profile(1.0, 2.0)
    assert profile(1.0) != "profile"


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))]
)
def test_copies_are_equal_and_read_only(copied):
    original = profile(1.0, 2.0)
    assert original.doubled[1] == 4.0
    again = copied(original)
    assert again == original
    assert "doubled" not in again.__dict__
    with pytest.raises(ValueError, match="read-only"):
        again.height_m[0] = 5.0


def test_representation_is_one_line_without_values():
    assert repr(profile(*np.zeros(1000))) == "Profile(height_m: (1000,) float64, values: 1 entries)"


def test_entries_of_a_read_only_mapping_cannot_be_set():
    entries = ReadOnlyMapping({"a": 1})
    with pytest.raises(TypeError):
        entries["b"] = 2
    assert {"c": 3} | entries == {"c": 3, "a": 1}
    assert pickle.loads(pickle.dumps(entries)) == copy.deepcopy(entries) == {"a": 1}
