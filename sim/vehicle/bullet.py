"""Bullet physics engine: one client with a world of its own, without messages on the terminal."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from survey.core.errors import ConfigError


class BulletClient:
    """Bullet client with a world of its own, closed with the object."""

    def __init__(self) -> None:
        with _silence():
            try:
                import pybullet
            except ImportError as error:
                raise ConfigError(
                    "physics.engine is 'contact', but pybullet is not installed (it has wheels up to Python 3.11); "
                    'set physics.engine = "kinematic".'
                ) from error
            self._client = pybullet.connect(pybullet.DIRECT)
        self._module = pybullet

    def __getattr__(self, name: str) -> Any:
        """Return Bullet's function of that name for this world, or its constant."""
        found = getattr(self._module, name)
        if callable(found):
            found = partial(found, physicsClientId=self._client)
        setattr(self, name, found)
        return found

    def __del__(self) -> None:
        if hasattr(self, "_client"):
            self._module.disconnect(self._client)


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress Bullet's messages on standard output and standard error."""
    sys.stdout.flush()
    sys.stderr.flush()
    copies = [os.dup(stream) for stream in (1, 2)]
    with Path(os.devnull).open("wb") as nowhere:
        for stream in (1, 2):
            os.dup2(nowhere.fileno(), stream)
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)
        for stream, copy in zip((1, 2), copies, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
