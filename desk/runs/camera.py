"""Camera of a run while it is simulated: the latest image that was written."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

_EVERY_S = 0.7


@contextmanager
def watched_frames(place: Path, report: Callable[[Path], None]) -> Iterator[None]:
    """Report new images below a folder while the body runs."""
    ended = Event()

    def follow() -> None:
        shown: Path | None = None
        while not ended.wait(_EVERY_S):
            frame = latest_frame(place)
            if frame is not None and frame != shown:
                shown = frame
                report(frame)

    thread = Thread(target=follow, name="desk-camera", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def latest_frame(place: Path) -> Path | None:
    """Return the last image but one below a folder, which is complete; None where there are fewer than two."""
    frames = sorted(place.glob("**/frames/*.png"))
    return frames[-2] if len(frames) > 1 else None
