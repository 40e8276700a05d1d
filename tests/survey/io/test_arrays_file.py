import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from survey import CapacityError, InputError
from survey.io import arrays_file
from survey.io.arrays_file import load_npz, read_arrays, read_npz, write_arrays, write_npz

ARRAYS = {
    "z": np.arange(30, dtype=np.float64).reshape(5, 6),
    "n": np.int64(3),
    "seen": np.array([True, False]),
}


def read(path):
    return read_npz(path, "the model", "save it again")


@pytest.mark.parametrize("compressed", [True, False])
def test_arrays_read_as_they_were_written(tmp_path, compressed):
    write_npz(tmp_path / "a.npz", ARRAYS, compressed=compressed)
    found = read(tmp_path / "a.npz")
    assert found.keys() == ARRAYS.keys()
    for name, values in ARRAYS.items():
        np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize("compressed", [True, False])
def test_no_flipped_bit_reads_as_other_values(tmp_path, compressed):
    path = tmp_path / "a.npz"
    write_npz(path, ARRAYS, compressed=compressed)
    stored = path.read_bytes()
    for bit in np.random.default_rng(1).choice(8 * len(stored), 400, replace=False):
        damaged = bytearray(stored)
        damaged[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(bytes(damaged))
        try:
            found = read(path)
        except InputError:
            continue
        assert found.keys() == ARRAYS.keys()
        assert all(np.array_equal(found[name], values) for name, values in ARRAYS.items())


def test_a_file_without_a_checksum_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", z=ARRAYS["z"])
    with pytest.raises(InputError, match="save it again"):
        read(tmp_path / "a.npz")


def test_pickled_objects_are_never_read(tmp_path):
    np.savez(tmp_path / "a.npz", allow_pickle=True, z=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="damaged or no model"):
        read(tmp_path / "a.npz")


def test_an_archive_of_other_files_is_refused(tmp_path):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("notes.txt", "no array")
    (tmp_path / "a.npz").write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="damaged or no model"):
        read(tmp_path / "a.npz")


def test_facts_and_arrays_keep_their_kind(tmp_path):
    write_arrays(tmp_path / "a.npz", "tin 1", {"datum": "EGM96"}, {"z": ARRAYS["z"]})
    facts, arrays = read_arrays(tmp_path / "a.npz", "tin 1")
    assert facts == {"datum": "EGM96"}
    np.testing.assert_array_equal(arrays["z"], ARRAYS["z"])
    with pytest.raises(InputError, match="'tin 1'; 'field 1' was expected"):
        read_arrays(tmp_path / "a.npz", "field 1")


def npy(shape: tuple[int, ...], content: bytes) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return stream.getvalue() + content


def test_an_archive_that_unpacks_to_too_much_is_refused_before_memory_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrays_file, "LARGEST_BYTES", 2**24)
    with (
        zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("z.npy", "w", force_zip64=True) as member,
    ):
        member.write(npy((2**22,), b""))
        for _ in range(32):
            member.write(bytes(2**20))
    assert (tmp_path / "bomb.npz").stat().st_size < 2**17
    with pytest.raises(CapacityError, match="16,777,216 can be read"):
        load_npz(tmp_path / "bomb.npz", "the model", "save it again")


def test_an_array_that_claims_more_than_is_stored_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("z.npy", npy((10**12,), bytes(80)))
    with pytest.raises(InputError, match="claims 8,000,000,000,000 bytes"):
        load_npz(tmp_path / "a.npz", "the model", "save it again")
