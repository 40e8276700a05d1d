"""The file of a plan: what is appended, what is read back, and who may write."""

import json
import signal
import subprocess
import sys

import numpy as np
import pytest

from desk.plan.document import PlanDocument
from desk.plan.history import MOST_STEPS, OutdatedError
from desk.plan.history_file import StoredHistory, read_history
from desk.plan.lock import HeldError, held
from survey.core.errors import ConfigError, InputError

SQUARE = ((0.0, 0.0), (90.0, 0.0), (90.0, 90.0), (0.0, 90.0))
HOLE = ((10.0, 10.0), (20.0, 10.0), (20.0, 20.0))
DRAWN = PlanDocument(areas=((SQUARE, HOLE),), starts=((3.0, 4.0),))


@pytest.fixture
def file(tmp_path):
    return tmp_path / "site.desk.json"


def opened(file) -> StoredHistory:
    return StoredHistory(file, DRAWN, "site.tif")


def moved(document: PlanDocument, corner: int, metres: float) -> PlanDocument:
    (outline, *holes), *others = document.areas
    x, y = outline[corner]
    ring = (*outline[:corner], (x + metres, y), *outline[corner + 1 :])
    return document.model_copy(update={"areas": ((ring, *holes), *others)})


def test_the_later_of_two_desks_does_not_erase_what_the_first_one_drew(file):
    first, second = opened(file), opened(file)
    first.edit(0, "First", moved(DRAWN, 0, 1.0))
    with pytest.raises(OutdatedError, match="another program"):
        second.edit(0, "Second", moved(DRAWN, 1, 1.0))
    assert second.document == first.document
    with pytest.raises(OutdatedError):  # a page that shows what was there before
        second.edit(0, "Second", moved(DRAWN, 1, 1.0))
    second.edit(second.revision, "Second", moved(second.document, 1, 1.0))
    with pytest.raises(OutdatedError):
        first.move(first.revision, -1)
    assert [step.title for step in read_history(file).steps] == ["Open", "First", "Second"]


def test_what_was_done_is_read_back(file):
    store, rng = opened(file), np.random.default_rng(1)
    for k in range(3 * MOST_STEPS):
        document = store.document
        chosen = rng.integers(9)
        if chosen == 0:
            store.move(store.revision, -int(rng.integers(1, 4)))
        elif chosen == 1:
            store.move(store.revision, 1)
        elif chosen == 2:
            store.set_aside(f"plan {rng.integers(4)}")
        elif chosen == 3:
            store.drop_variant(int(rng.integers(3)))
        elif chosen == 4:
            areas = (*document.areas, (SQUARE,)) if len(document.areas) < 4 else document.areas[:1]
            store.edit(store.revision, "Polygons", document.model_copy(update={"areas": areas}))
        elif chosen == 5:
            settings = {"pattern": "lawnmower", "swaths": k, "heading_deg": None}
            store.edit(
                store.revision, "Set", document.model_copy(update={"planner": settings, "no_go": ((HOLE,),)})
            )
        else:
            store.edit(store.revision, "Move", moved(document, int(rng.integers(4)), float(k)))
        if k % 50 == 0:
            assert read_history(file) == store.history
    assert read_history(file) == store.history
    assert len(file.read_bytes().splitlines()) < 5 * MOST_STEPS


def test_an_edit_appends_what_it_changes(file):
    angles = np.linspace(0.0, 2.0 * np.pi, 19_000, endpoint=False)
    ring = tuple(zip(np.cos(angles).tolist(), np.sin(angles).tolist(), strict=True))
    store = StoredHistory(file, PlanDocument(areas=((ring,),)), "site.tif")
    store.write()
    before = file.stat().st_size
    for k in range(200):
        store.edit(store.revision, "Move a corner", moved(store.document, 17 * k, 0.01))
    assert file.stat().st_size - before < 200 * 300
    assert read_history(file).document == store.document


def test_an_edit_that_was_cut_off_is_left_out(file):
    store = opened(file)
    store.edit(0, "Whole", moved(DRAWN, 0, 1.0))
    whole = file.read_bytes()
    store.edit(1, "Cut", moved(DRAWN, 0, 2.0))
    file.write_bytes(file.read_bytes()[:-7])
    again = opened(file)
    assert again.history.undo_title == "Whole"
    again.edit(0, "Next", moved(DRAWN, 0, 3.0))
    assert file.read_bytes().startswith(whole)
    assert [step.title for step in read_history(file).steps] == ["Open", "Whole", "Next"]


@pytest.mark.parametrize(
    ("line", "error"),
    [
        (b"{", InputError),
        (b"[]", InputError),
        (b'{"title": "A"}', ConfigError),
        (b'{"by": 0.5}', ConfigError),
        (b'{"title": "A", "document": {"areas": [[{"keep": [3, 9]}]]}}', InputError),
        (b'{"title": "A", "document": {"areas": [[{"keep": [1, 1]}]]}}', InputError),
        (b'{"title": "A", "document": {"stated": {"unknown": 1}}}', ConfigError),
    ],
)
def test_a_damaged_line_is_refused_with_its_number(file, line, error):
    opened(file).write()
    file.write_bytes(file.read_bytes() + line + b"\n")
    with pytest.raises(error, match="line 2"):
        read_history(file)


def test_a_plan_of_the_first_version_is_read_and_written_anew(file):
    documents = [DRAWN, moved(DRAWN, 0, 1.0)]
    steps = [
        {"title": f"Step {k}", "document": one.model_dump(mode="json")} for k, one in enumerate(documents)
    ]
    file.write_text(
        json.dumps({"schema_version": 1, "terrain": "site.tif", "at": 1, "steps": steps}, indent=2)
    )
    store = opened(file)
    assert store.document == documents[1]
    store.edit(0, "Move", moved(documents[1], 2, 1.0))
    assert [step.title for step in read_history(file).steps] == ["Step 0", "Step 1", "Move"]
    assert json.loads(file.read_bytes().splitlines()[0])["schema_version"] == 2


def test_a_plan_is_held_by_one_desk_which_the_next_one_finds(file):
    with held(file) as publish:
        publish("http://127.0.0.1:1/?token=a")
        with pytest.raises(HeldError, match=r"http://127\.0\.0\.1:1/\?token=a"), held(file):
            pass
        assert file.with_name("site.desk.lock").stat().st_mode & 0o077 == 0
    with held(file):
        pass
    assert not file.with_name("site.desk.lock").exists()


def test_a_killed_desk_holds_nothing(file):
    hold = "from desk.plan.lock import held; from pathlib import Path; import sys, time\n"
    hold += "with held(Path(sys.argv[1])) as publish:\n publish('there'); print('held', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", hold, str(file)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"held\n"
        with pytest.raises(HeldError, match="there"), held(file):
            pass
        process.send_signal(signal.SIGKILL)
    with held(file):
        pass
