from datetime import date

import pytest

from planners.season import SeasonConfig
from survey.core.errors import ConfigError

FIRST, LAST = date(2026, 5, 1), date(2026, 9, 18)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"surface": "unknown"}, "the surface of a season is unknown"),
        ({"last_day": FIRST}, "give a later day"),
        ({"wanted": 0.0}, "wanted is 0"),
        ({"melt_m_we_day": -1.0}, "melt_m_we_day is -1"),
        ({"unit": "%", "melt_m_we_day": 0.0}, "no error in percent"),
    ],
)
def test_settings_out_of_range_are_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        SeasonConfig(**{"wanted": 0.2, "unit": "m w.e.", "first_day": FIRST, "last_day": LAST} | change)


def test_the_expected_change_is_the_melt_of_the_days_between():
    config = SeasonConfig(0.2, "m w.e.", FIRST, LAST, surface="snow", melt_m_we_day=0.017)
    assert config.change_m == pytest.approx(140 * 0.02)
