from planners.guarantee.survey_lines import fewest


def test_the_fewest_that_are_enough_are_found_from_anywhere():
    for wanted in (1, 2, 9, 30):
        for first in (-1, 1, 8, 30):
            assert fewest(lambda n, wanted=wanted: n >= wanted, first=first, most=30) == wanted
    assert fewest(lambda n: n > 30, first=3, most=30) is None
