"""A changed line of a log is refused."""

import pytest

from survey.core.documents import cut_incomplete_line, log_line, read_log
from survey.core.errors import InputError

ENTRIES = [{"level": "info", "message": "Größe 3 m"}, {"level": "warning", "message": "no fix\nfor 3 s"}]


@pytest.fixture
def log(tmp_path):
    file = tmp_path / "log.jsonl"
    file.write_text("".join(log_line(entry) + "\n" for entry in ENTRIES), encoding="utf-8")
    return file


def test_lines_are_read_as_they_were_written(log):
    assert [{key: entry[key] for key in ("level", "message")} for entry in read_log(log)] == ENTRIES


def test_no_flipped_bit_reads_as_another_line(log):
    content = log.read_bytes()
    for place in range(len(content)):
        log.write_bytes(content[:place] + bytes([content[place] ^ 1 << place % 8]) + content[place + 1 :])
        with pytest.raises(InputError, match="was changed or is not complete"):
            read_log(log)


def test_a_log_without_records_is_empty(log):
    log.write_bytes(b"")
    assert read_log(log) == []


def test_a_line_that_a_killed_process_has_not_completed_is_refused_and_then_cut(log):
    content = log.read_bytes()
    log.write_bytes(content + b'{"level": "in')
    with pytest.raises(InputError, match="line 3 of the log"):
        read_log(log)
    cut_incomplete_line(log)
    assert log.read_bytes() == content
