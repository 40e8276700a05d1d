"""Edits, undo and redo over the server."""

import pytest

from desk.plan.history_file import read_history
from desk.workspace import open_workspace
from survey.data.outlines import MOST_CORNERS
from tests.desk.conftest import SOUTH, SQUARE, WEST


def edit(page, **changes):
    state = page.get("/api/plan").json()
    return page.post(
        "/api/edit",
        {"revision": state["revision"], "title": "Test", "document": {**state["document"], **changes}},
    )


def test_an_edit_is_stored_and_found_again(page, workspace, dem_file):
    assert edit(page, starts=[[WEST + 250.0, SOUTH + 250.0]]).status_code == 200
    stored = read_history(workspace.store.path)
    assert stored.document.starts == ((WEST + 250.0, SOUTH + 250.0),)
    place = workspace.store.path.with_name("hills.tif")
    place.write_bytes(dem_file.read_bytes())
    with open_workspace(None, workspace.folder) as again:
        assert again.store.document == workspace.store.document
        assert again.store.history.undo_title == "Test"


def test_undo_and_redo_return_the_documents(page):
    first = page.get("/api/plan").json()["document"]
    second = edit(page, areas=[]).json()
    assert second["undo"] == "Test"
    assert second["redo"] is None
    undone = page.post("/api/undo", {"revision": second["revision"]}).json()
    assert undone["document"] == first
    assert undone["redo"] == "Test"
    redone = page.post("/api/redo", {"revision": undone["revision"]}).json()
    assert redone["document"] == second["document"]


def test_an_edit_of_an_outdated_document_is_refused(page, workspace):
    edit(page, areas=[])
    answer = page.post("/api/edit", {"revision": 0, "title": "Late", "document": {}})
    assert answer.status_code == 409
    assert "another window" in answer.json()["error"]
    assert workspace.store.revision == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"areas": [[[[0, 0], [1, 1]]]]},
        {"areas": [[[[0, 0], [1, "x"], [2, 2]]]]},
        {"starts": [[1.0]]},
        {"starts": [[None, 1.0]]},
        {"unknown": 1},
        {"planner": {"swaths": [1, 2, 3]}},
        {"areas": [[[[k, k * k] for k in range(MOST_CORNERS + 1)]]]},
    ],
)
def test_a_wrong_document_is_refused_in_a_sentence(page, workspace, changes):
    answer = edit(page, **changes)
    assert answer.status_code == 422
    assert answer.json()["error"].endswith(".")
    assert workspace.store.revision == 0
    assert not workspace.store.path.exists()


@pytest.mark.parametrize(
    "body",
    [b"", b"[]", b"null", b"{", b"[" * 100_000, b"\xff\xfe", b'{"revision": NaN}', b'{"revision": 1e999}'],
)
def test_a_body_that_is_no_edit_is_refused(page, body):
    answer = page.post("/api/edit", body)
    assert answer.status_code == 422
    assert answer.json()["error"].endswith(".")


def test_an_outline_that_crosses_itself_is_stored_and_the_plan_refused(page):
    crossed = [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]]
    assert edit(page, areas=[[crossed]]).status_code == 200
    answer = page.get("/api/route")
    assert answer.status_code == 422
    assert "elf" in answer.json()["error"]


def test_a_file_that_cannot_be_written_leaves_the_document(page, workspace, monkeypatch):
    def full(*_):
        from survey.core.errors import InputError

        raise InputError("the disk is full; free space.")

    monkeypatch.setattr("desk.plan.history_file.write_bytes", full)
    before = workspace.store.document
    answer = edit(page, areas=[])
    assert answer.status_code == 422
    assert "disk is full" in answer.json()["error"]
    assert workspace.store.document == before
    assert workspace.store.revision == 0
