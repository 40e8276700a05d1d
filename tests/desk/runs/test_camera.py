"""Camera of a run while it is simulated."""

import time
from pathlib import Path

from desk.jobs.mission import latest_frame, watched_frames


def write(folder: Path, *numbers: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        (folder / f"{number:06d}.png").write_bytes(b"image")


def test_the_image_that_is_being_written_is_not_shown(tmp_path):
    assert latest_frame(tmp_path) is None
    write(tmp_path / "2-simulate.partial" / "recording" / "frames", 0)
    assert latest_frame(tmp_path) is None
    write(tmp_path / "2-simulate.partial" / "recording" / "frames", 1, 2)
    frame = latest_frame(tmp_path)
    assert frame is not None
    assert frame.stem == "000001"


def test_new_images_are_reported_while_the_run_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr("desk.jobs.mission._EVERY_S", 0.01)
    seen: list[str] = []
    with watched_frames(tmp_path, lambda frame: seen.append(frame.stem)):
        write(tmp_path / "frames", 0, 1)
        until = time.monotonic() + 10.0
        while not seen and time.monotonic() < until:
            time.sleep(0.01)
    assert seen[0] == "000000"
    assert len(seen) == len(set(seen))
