"""Angles are read in the ways that receivers and maps write them, and in no other."""

import pytest

from survey.io.text_tables import degrees

NORTH = 46.0 + 30.0 / 60.0 + 12.5 / 3600.0


@pytest.mark.parametrize(
    "text",
    [
        "46°30'12.5\"N",
        "46° 30' 12.5\" N",
        "46°30′12.5″N",
        "46º30’12.5”N",
        "46°30'12.5''",
        "N 46 30 12.5",
        "N46°30'12.5\"",
        "46 30 12.5 N",
        "46 30 12.5n",
        "46d30'12.5\"N",
        "46:30:12.5",
        "46-30-12.5",
        "46-30-12.5N",
        "+46 30 12.5",
        "46°30.208333333'N",
        "46 30.208333333",
        "46.50347222°",
        "46.50347222 N",
    ],
)
def test_one_angle_is_read_in_many_ways(text: str) -> None:
    assert degrees(text, "latitude") == pytest.approx(NORTH, abs=1e-8)


@pytest.mark.parametrize(
    ("text", "axis", "angle"),
    [
        ("46 30 12.5 S", "latitude", -NORTH),
        ("46°30'12.5\"S", "latitude", -NORTH),
        ("S46°30'12.5\"", "latitude", -NORTH),
        ("46.5 s", "latitude", -46.5),
        ("-46 30 12.5", "latitude", -NORTH),
        ("-0 30 0", "latitude", -0.5),
        ("-135-07-30", "longitude", -135.125),
        ("135 7 30 W", "longitude", -135.125),
        ("W 135°7.5'", "longitude", -135.125),
        ("007°15'00\"E", "longitude", 7.25),
    ],
)
def test_south_and_west_are_negative(text: str, axis: str, angle: float) -> None:
    assert degrees(text, axis) == pytest.approx(angle, abs=1e-12)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "N",
        "46 60 0",
        "46 30 60",
        "46.5 30 0",
        "46 30.5 10",
        "91 0 0",
        "-46 30 0 S",
        "N 46 30 0 N",
        "46 30 12.5 E",
        "46 30 12.5 O",
        "46 30 12.5 N x",
        "463012.5N",
        "46 30 12 5",
        "46--30-12.5",
        "46-30-12.5-",
        "GCP 46",
        "46 30 12,5",
    ],
)
def test_what_could_be_another_angle_is_none(text: str) -> None:
    assert degrees(text, "latitude") is None
