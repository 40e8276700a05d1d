"""Commands without the pictures beside their results, which take most of their time; tests of pictures ask for them."""

import pytest

from firnline.actions.requests import PictureOptions


@pytest.fixture(autouse=True)
def no_pictures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no pictures, unless the test has the mark ``pictures``."""
    if request.node.get_closest_marker("pictures") is None:
        monkeypatch.setattr(PictureOptions, "write_pictures", _draw_nothing)


def _draw_nothing(*_: object) -> None:
    """Stand in the place of `PictureOptions.write_pictures`."""
