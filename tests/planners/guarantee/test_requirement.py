from dataclasses import replace

import pytest

from planners.guarantee.requirement import MapRequirement, reachable_class
from survey.core.errors import ConfigError


def test_what_is_reachable_is_named_by_its_class():
    assert "0.3048 m" in str(reachable_class(0.25))
    assert reachable_class(0.5) is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"probability": 1.0}, "between 0 and 1"),
        ({"noise_m": -1.0}, "noise_m is -1.0"),
        ({"limit_m": 0.0}, "limit_m"),
        ({"assumed": "fractal"}, "no family of covariances"),
    ],
)
def test_wishes_out_of_range_are_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        replace(MapRequirement(0.4572), **change)
