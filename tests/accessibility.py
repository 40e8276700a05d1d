"""Violations of the rules of accessibility on a page, as axe-core finds them."""

from typing import Any


def violations(page: Any) -> list[str]:
    """Return rule and first element of each violation on a page that a browser shows."""
    from axe_playwright_python.sync_playwright import Axe

    return [
        f"{found['id']}: {found['nodes'][0]['html'][:140]}"
        for found in Axe().run(page).response["violations"]
    ]
