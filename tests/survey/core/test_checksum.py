"""Checksums depend on every byte, and altered values are refused."""

from pathlib import Path

import numpy as np
import pytest

from survey import InputError
from survey.io.arrays_file import checksum, refuse_altered


def test_every_bit_changes_the_checksum() -> None:
    content = np.arange(4.0)
    stated = checksum([content, "EGM96 height"])
    for bit in range(8 * content.nbytes):
        altered = bytearray(content.tobytes())
        altered[bit // 8] ^= 1 << (bit % 8)
        assert checksum([np.frombuffer(altered), "EGM96 height"]) != stated


def test_altered_values_are_refused_with_the_place_of_the_checksum() -> None:
    refuse_altered(Path("a.tif"), checksum([np.zeros(3)]), [np.zeros(3)], "the tag CRC")
    with pytest.raises(InputError, match=r"a\.tif is damaged.*the tag CRC says '00000000'"):
        refuse_altered(Path("a.tif"), "00000000", [np.zeros(3)], "the tag CRC")
