import pytest

from planners.guarantee.spending import asked_at


def test_all_looks_together_spend_no_more_than_is_promised():
    spent = [1.0 - asked_at(0.9, look) for look in range(1, 10_001)]
    assert sum(spent) == pytest.approx(0.1, abs=2e-5)
    assert sum(spent) < 0.1
    assert all(one > 0.0 for one in spent)
