"""The picture of the documentation: ``FIRNLINE_PICTURES=docs/images`` writes it again."""

import os
from pathlib import Path

import pytest

from desk.demo import write_demo
from desk.sources import open_workspace
from tests.desk.browser.conftest import DeskPage, DeskServer

pytestmark = pytest.mark.walkthrough


def test_the_demo_is_pictured(browser, tmp_path):
    with open_workspace(write_demo(tmp_path / "demo"), tmp_path) as workspace:
        server = DeskServer(workspace)
        context = browser.new_context(viewport={"width": 1280, "height": 760})
        demo = DeskPage(context, server).open()
        demo.wait_for_error()
        demo.page.evaluate("document.querySelector('#saved').textContent = 'Stored in /home/ada/survey'")
        demo.page.wait_for_timeout(300)
        picture = demo.page.screenshot()
        assert demo.page.inner_text("#rmse").endswith(" m")
        assert len(picture) > 50_000
        if "FIRNLINE_PICTURES" in os.environ:
            Path(os.environ["FIRNLINE_PICTURES"], "desk.png").write_bytes(picture)
        context.close()
        server.stop()
