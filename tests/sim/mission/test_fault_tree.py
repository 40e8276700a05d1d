"""Fault trees: every missed run counts once on each level, and the picture has a box for each event."""

from sim.mission.rehearsal import NOTHING, FaultEvent, fault_tree, fault_tree_plot, summarize_outcomes

FOUND = [
    {"cause": "met", "events": ["gps: jump"]},
    {"cause": "lost", "events": ["stalled", "tracks: stopped"]},
    {"cause": "lost", "events": ["drawn loss", "stalled"]},
    {"cause": "level", "events": []},
    {"cause": "level", "events": ["gps: jump"]},
    {"cause": "level", "events": []},
    {"cause": "shape", "events": []},
    {"cause": "refused", "events": [], "message": "the area has no room."},
]


def leaves(event: FaultEvent) -> list[FaultEvent]:
    return [leaf for part in event.parts for leaf in leaves(part)] if event.parts else [event]


def test_every_missed_run_counts_once_on_each_level():
    tree = fault_tree(FOUND)
    assert tree.n_runs == 7
    assert sum(part.n_runs for part in tree.parts) == 7
    assert sum(leaf.n_runs for leaf in leaves(tree)) == 7
    assert [part.name for part in tree.parts] == ["error of the map", "rover lost", "mission refused"]


def test_faults_stand_below_the_failures_of_their_runs():
    of_map, lost, refused = fault_tree(FOUND).parts
    assert [part.name for part in of_map.parts] == ["level of the map", "shape of the map"]
    assert of_map.parts[0].parts == (FaultEvent(NOTHING, 2), FaultEvent("gps: jump", 1))
    assert {part.name for part in lost.parts} == {"stalled, tracks: stopped", "drawn loss, stalled"}
    assert refused.parts == (FaultEvent("the area has no room.", 1),)


def test_the_picture_has_a_box_for_every_event():
    axes = fault_tree_plot(summarize_outcomes(FOUND), fault_tree(FOUND)).axes[0]
    labels = [text.get_text().replace("\n", " ") for text in axes.texts]
    assert "class missed: 7" in labels
    assert f"{NOTHING}: 2" in labels
    assert len(labels) == 12
    assert "12%" in axes.get_title(loc="left")


def test_a_rehearsal_without_a_miss_has_a_single_box():
    met = [{"cause": "met", "events": []}]
    axes = fault_tree_plot(summarize_outcomes(met), fault_tree(met)).axes[0]
    assert [text.get_text() for text in axes.texts] == ["class missed: 0"]
