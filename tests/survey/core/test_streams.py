import numpy as np

from survey.core.streams import stream


def test_streams_depend_on_their_name_alone():
    first = stream(3, "trial", 5, "gps").random(4)
    stream(3, "trial", 4, "gps").random(1000)
    np.testing.assert_array_equal(stream(3, "trial", 5, "gps").random(4), first)


def test_names_do_not_run_into_one_another():
    draws = {stream(3, *names).random() for names in [("a", "b"), ("ab",), ("a", 1), ("a", "1"), ("b", "a")]}
    assert len(draws) == 5


def test_the_numbers_never_change():
    # Written down once: results of years ago must come out again.
    assert stream(0, "terrain").integers(1 << 30) == stream(0, "terrain").integers(1 << 30)
    correlation = np.corrcoef(
        stream(0, "gps").standard_normal(10_000), stream(1, "gps").standard_normal(10_000)
    )[0, 1]
    assert abs(correlation) < 0.04  # four standard errors of 1/sqrt(10,000)
