"""Plans that are set aside."""

import pytest


def test_a_variant_is_set_aside_compared_and_removed(page, workspace):
    found = page.post("/api/variants", {"name": "dense"}).json()["variants"]
    assert [variant["name"] for variant in found] == ["dense"]
    assert found[0]["facts"]["rmse_m"].endswith(" m")
    assert workspace.store.revision == 0
    assert page.post("/api/variants", {"name": "dense"}).json()["variants"][0]["name"] == "dense"
    assert page.delete("/api/variants/0").json()["variants"] == []


@pytest.mark.parametrize("name", ["", "   ", "x" * 81, 7, None])
def test_a_variant_needs_a_name(page, name):
    assert page.post("/api/variants", {"name": name}).status_code == 422


def test_a_variant_that_is_refused_says_why(page):
    state = page.get("/api/plan").json()
    page.post("/api/edit", {"revision": 0, "title": "Empty", "document": {**state["document"], "areas": []}})
    (row,) = page.post("/api/variants", {"name": "empty"}).json()["variants"]
    assert "no area is drawn" in row["error"]
