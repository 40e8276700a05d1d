"""Plans that are set aside."""

import pytest


def test_a_variant_is_set_aside_compared_and_removed(page, workspace):
    found = page.post("/api/variants", {"name": "dense"}).json()["variants"]
    assert [variant["name"] for variant in found] == ["dense"]
    assert found[0]["facts"]["rmse_m"].endswith(" m")
    assert workspace.store.revision == 1
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


def test_setting_aside_and_removing_are_undone(page, workspace):
    page.post("/api/variants", {"name": "dense"})
    page.delete("/api/variants/0")
    assert workspace.store.history.undo_title == "Remove dense"
    assert page.post("/api/undo", {"revision": 2}).json()["variants"] == ["dense"]
    assert page.post("/api/undo", {"revision": 3}).json()["variants"] == []
    assert page.post("/api/redo", {"revision": 4}).json()["variants"] == ["dense"]


def test_variants_outlast_the_oldest_steps(workspace):
    store = workspace.store
    store.set_aside("first")
    for _ in range(205):
        store.edit(store.revision, "Edit", store.document)
    assert [variant.name for variant in store.history.set_aside] == ["first"]
    assert len(store.history.steps) == 200


def test_a_variant_stands_beside_the_plan(page, workspace):
    page.post("/api/variants", {"name": "four"})
    document = page.get("/api/plan").json()["document"]
    planner = {"pattern": "lawnmower", "swaths": 8}
    page.post("/api/edit", {"revision": 1, "title": "Set", "document": {**document, "planner": planner}})
    found = page.get("/api/variants/0/beside").json()
    rows = {row[0]: row[1:] for row in found["rows"]}
    assert rows["swaths"] == ["8", "4", ""]
    assert rows["length"][2].startswith("−")
    assert rows["predicted RMSE"][2].startswith("+")
    assert found["error"]["limits"] == found["error_of_other"]["limits"]
    assert found["error"]["image"] != found["error_of_other"]["image"]
    assert found["lines"]
    assert page.get("/api/variants/7/beside").status_code == 422


def test_notes_are_stored_with_the_plan_and_compute_nothing_anew(page, workspace):
    before = workspace.planner.exact(workspace.store.document).plan
    document = {**page.get("/api/plan").json()["document"], "notes": "crevasse in the north\n<b>2 m</b>"}
    page.post("/api/edit", {"revision": 0, "title": "Write a note", "document": document})
    assert page.get("/api/plan").json()["document"]["notes"] == document["notes"]
    assert workspace.planner.exact(workspace.store.document).plan is before
