import errno
import os
import signal
import subprocess
import sys
import time

import pytest
import typer
from typer.testing import CliRunner

from firnline.cli.outcome import INTERRUPTED, OUTPUT_CLOSED, with_exit_codes
from firnline.cli.request import Verbose
from survey.core.errors import CapacityError, ConfigError, InputError

FIRNLINE = [sys.executable, "-m", "firnline"]


def ended(error: BaseException) -> tuple[int, str]:
    """Exit code and stderr of a command that raises an error."""
    app = typer.Typer()

    def failing() -> None:
        raise error

    app.command()(with_exit_codes(failing))
    result = CliRunner().invoke(app, [])
    return result.exit_code, result.stderr


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (InputError("the area is empty; give another."), 3, "firnline: the area is empty; give another."),
        (ConfigError("no."), 4, "firnline: no."),
        (CapacityError("too large."), 3, "too large"),
        (KeyboardInterrupt(), INTERRUPTED, "interrupted"),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), OUTPUT_CLOSED, ""),
        (
            MemoryError("Unable to allocate 16 TiB"),
            3,
            "the memory does not suffice (Unable to allocate 16 TiB)",
        ),
        (
            OSError(errno.ENOSPC, "No space left on device", "a.tif"),
            3,
            "a.tif: No space left on device; free space",
        ),
        (PermissionError(errno.EACCES, "Permission denied", "a.tif"), 3, "a.tif: Permission denied; check"),
        (UnicodeEncodeError("utf-8", "dem\udcff.tif", 3, 4, "surrogates not allowed"), 3, "not valid UTF-8"),
        (ZeroDivisionError("division by zero"), 1, "internal fault, ZeroDivisionError: division by zero"),
    ],
)
def test_every_error_ends_in_one_sentence_and_its_code(error, code, words):
    found, err = ended(error)
    assert found == code
    assert words in err
    assert len(err.splitlines()) == bool(words)


def test_only_a_full_disk_asks_for_space():
    assert "free space" not in ended(OSError(errno.EIO, "Input/output error", "camera.toml"))[1]


def test_control_characters_of_names_do_not_reach_the_terminal():
    assert ended(InputError("the area 'a\x1b[2J\r\nb' is empty."))[1].count("\n") == 1
    assert "é\\x1b\\x07\\udcff" in ended(InputError("é\x1b\x07\udcff"))[1]


@pytest.mark.parametrize("arguments", [["--help"], ["reproduce", "--list"]])
def test_a_closed_pipe_ends_quietly(arguments):
    with subprocess.Popen([*FIRNLINE, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()  # before anything is written
        assert process.stderr.read() == b""
    assert process.returncode in (0, OUTPUT_CLOSED)


@pytest.mark.parametrize("arguments", [["--help"], ["reproduce", "--list"]])
def test_a_full_output_is_refused_in_one_sentence(arguments):
    with open("/dev/full", "wb") as full:  # noqa: PTH123
        result = subprocess.run([*FIRNLINE, *arguments], stdout=full, stderr=subprocess.PIPE, check=False)
    assert result.returncode == 3
    assert result.stderr == b"firnline: the output: No space left on device; free space.\n"


@pytest.mark.parametrize("delay_s", [0.2, 0.4])
def test_an_interrupt_while_packages_are_imported_prints_no_traceback(delay_s):
    with subprocess.Popen(
        [*FIRNLINE, "doctor"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process:
        time.sleep(delay_s)
        process.send_signal(signal.SIGINT)
        assert b"Traceback" not in process.stderr.read()
    assert process.returncode in (0, INTERRUPTED, -signal.SIGINT)  # a shell sees 130 for both


@pytest.mark.parametrize("text", ["a = " + "[" * 20_000 + "]" * 20_000, "[" + ".".join("a" * 20_000) + "]"])
def test_settings_that_nest_too_deeply_are_refused(tmp_path, text):
    (tmp_path / "m.toml").write_text(text)
    result = subprocess.run(
        [*FIRNLINE, "run", "m.toml"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert result.returncode == 4, result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_a_name_that_is_no_utf8_is_refused_or_printed_with_escapes(tmp_path):
    name = os.fsencode(tmp_path) + b"/m\xff.toml"
    for command in ("run", "init"):
        result = subprocess.run([*FIRNLINE, command, name], capture_output=True, cwd=tmp_path, check=False)
        assert result.returncode in (0, 3), result.stderr
        assert b"Traceback" not in result.stderr
        assert b"m\\udcff.toml" in result.stdout + result.stderr


@pytest.mark.parametrize("has_option", [True, False])
def test_an_internal_fault_names_a_way_to_the_traceback_that_works(monkeypatch, has_option):
    app = typer.Typer()

    def quiet() -> None:
        raise ZeroDivisionError("division by zero")

    def detailed(verbose: Verbose = 0) -> None:
        raise ZeroDivisionError("division by zero")

    app.command()(with_exit_codes(detailed if has_option else quiet))
    err = CliRunner().invoke(app, []).stderr
    assert ("that -vv prints" in err) == has_option
    assert ("that FIRNLINE_TRACEBACK=1 before the command prints" in err) != has_option
    assert "Traceback" not in err
    monkeypatch.setenv("FIRNLINE_TRACEBACK", "1")
    assert "Traceback" in CliRunner().invoke(app, []).stderr
