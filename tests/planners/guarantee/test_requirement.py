from dataclasses import replace

import pytest

from planners.guarantee.adaptive import AdaptiveConfig
from planners.guarantee.requirement import MapRequirement
from survey.core.errors import ConfigError


@pytest.mark.parametrize(
    ("change", "words"),
    [
        *(
            ({"probability": value}, "above 0.5 and at most 0.999")
            for value in (1e-300, 0.5, 0.9999, 1.0, float("nan"))
        ),
        ({"noise_m": -1.0}, "noise_m is -1.0"),
        ({"limit_m": 0.0}, "limit_m"),
        ({"assumed": "fractal"}, "no family of covariances"),
    ],
)
def test_wishes_out_of_range_are_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        replace(MapRequirement(0.4572), **change)


def test_an_adaptive_survey_refuses_the_same_probabilities():
    with pytest.raises(ConfigError, match=r"above 0\.5 and at most 0\.999"):
        AdaptiveConfig(limit_m=0.4572, probability=1e-300)
    assert MapRequirement(0.4572, 0.999).probability == 0.999
