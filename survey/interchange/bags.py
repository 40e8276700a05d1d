"""Opening of ROS 1 and ROS 2 bags without ROS."""

import sqlite3
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from survey.core.errors import InputError
from survey.core.files.library_messages import first_line

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader


@contextmanager
def opened_bag(place: Path, files: Sequence[Path] = ()) -> Iterator["AnyReader"]:
    """Open a bag; its messages are defined by itself or, where it has no definitions, as in the newest ROS.

    Parameters
    ----------
    place : Path
        A ``.bag`` of ROS 1, or the folder of a ROS 2 bag.
    files : sequence of Path
        Files of a ROS 1 bag that was split, which are read as one; none where it was not.

    Yields
    ------
    rosbags.highlevel.AnyReader
        Reader of the bag.

    Raises
    ------
    InputError
        rosbags is not installed, or the bag is damaged, which may appear while it is read.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.rosbag1 import ReaderError as FirstReaderError
        from rosbags.rosbag2 import ReaderError as SecondReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(
            f"{place} is a bag, and reading it needs rosbags; install firnline[bags]."
        ) from error
    damage = (AnyReaderError, FirstReaderError, SecondReaderError, sqlite3.Error, struct.error, OSError)
    try:
        with AnyReader(list(files) or [place], default_typestore=get_typestore(Stores.LATEST)) as reader:
            yield reader
    except damage as error:
        raise InputError(
            f"{place} is damaged or no bag ({first_line(error)}); record or copy it again."
        ) from error
