"""What other programs wrote: JSON, and the guard around libraries."""

import errno

import pytest

from survey.core import CapacityError, ConfigError, InputError, parse_json, refusing_damage


def test_json_is_refused_where_two_programs_would_read_it_differently() -> None:
    refused = {
        "twice": '{"a": {"crs": 1, "crs": 2}}',
        "deeper than 100": "[" * 101 + "]" * 101,
        "no JSON": b"\xff\xfe{}",
        "digits": '{"a": ' + "1" * 5000 + "}",
    }
    for words, text in refused.items():
        with pytest.raises(InputError, match=f"^the plan.*{words}.*; save it again.$"):
            parse_json(text, "the plan a.plan", "save it again")


def test_json_of_other_programs_is_read() -> None:
    brackets = "[" * 200
    assert parse_json(b'\xef\xbb\xbf{"a": "' + brackets.encode() + b'\\""}', "it") == {"a": brackets + '"'}
    assert parse_json("[" * 100 + "]" * 100, "it")
    assert parse_json('{"a": {"x": 1}, "b": {"x": Infinity}}', "it")["b"] == {"x": float("inf")}


class PanicException(BaseException):
    """Stands for what libraries in Rust raise."""


@pytest.mark.parametrize(
    ("fault", "kind", "said"),
    [
        (
            IndexError("index 0 is out of bounds"),
            InputError,
            r"the bag a is damaged or no bag \(index 0 is out",
        ),
        (KeyError("time"), InputError, r"\(it lacks 'time'\); get it again\.$"),
        (AssertionError(), InputError, r"\(AssertionError\)"),
        (UnicodeDecodeError("utf-8", b"\x80", 0, 1, "invalid"), InputError, "can't decode"),
        (RecursionError("too deep"), InputError, "too deep"),
        (PanicException("unwrap"), InputError, "unwrap"),
        (ValueError("first\n  second"), InputError, r"\(first second\)"),
        (MemoryError(), CapacityError, "cannot be read: the memory does not suffice; .*ulimit -v"),
        (
            OSError(errno.EMFILE, "Too many open files"),
            CapacityError,
            "cannot be read: too many files are open; .*ulimit -n",
        ),
        (ConfigError("as it is."), ConfigError, "^as it is.$"),
    ],
)
def test_whatever_a_library_raises_becomes_one_sentence(fault, kind, said):
    with pytest.raises(kind, match=said), refusing_damage("the bag a", "bag"):
        raise fault


def test_an_interruption_is_no_damage():
    with pytest.raises(KeyboardInterrupt), refusing_damage("the bag a", "bag"):
        raise KeyboardInterrupt
