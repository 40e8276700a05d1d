"""Check of the built pages."""

from docs.check_links import faults


def page(body):
    return f"<html><body>{body}</body></html>"


def test_a_missing_file_and_a_missing_anchor_are_found(tmp_path):
    (tmp_path / "a.html").write_text(
        page('<a href="b.html#there">1</a><a href="b.html#gone">2</a><a href="c.html">3</a>')
    )
    (tmp_path / "b.html").write_text(page('<h1 id="there">b</h1>'))
    assert faults(tmp_path) == [
        "a.html links to b.html#gone, which is not there",
        "a.html links to c.html, which is not there",
    ]


def test_a_script_from_a_network_is_found_and_a_link_to_one_is_not(tmp_path):
    (tmp_path / "a.html").write_text(
        page('<script src="https://example.org/x.js"></script><a href="https://example.org">x</a>')
    )
    assert faults(tmp_path) == ["a.html loads https://example.org/x.js"]
