"""Headers and rows of PLY files, compared with the package plyfile."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import plyfile
import pytest

from survey.core.errors import InputError
from survey.io.ply import PlyError, read_header, read_vertices, write_vertices
from survey.io.point_chunks import ply_chunks, point_file_facts

TYPES = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]
HEAD = (
    "ply\nformat ascii 1.0\ncomment crs  EPSG:32608\nelement vertex 2\ncomment of vertices\nobj_info of nothing\n"
    "property float x\nproperty double y\nproperty uchar z\nend_header\n"
)
ROWS = "1 2 3\n4 5 6\n"


def mesh(rng: np.random.Generator, lengths: list[int]) -> list[Any]:
    """Return elements before and after the vertices, with and without lists."""
    vertices = np.empty(40, [(f"v{kind}", kind) for kind in TYPES])
    for name in vertices.dtype.names:
        vertices[name] = rng.integers(0, 100, 40)
    pose = np.array([(1.5, 2.5)], [("a", "f8"), ("b", "f8")])
    faces = np.empty(len(lengths), [("quality", "f4"), ("vertex_indices", "O")])
    for k, length in enumerate(lengths):
        faces[k] = k, rng.integers(0, 40, length)
    describe = plyfile.PlyElement.describe
    return [describe(pose, "camera"), describe(faces, "face"), describe(vertices, "vertex")]


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize("lengths", [[3] * 30, [3, 4] * 10, [3] * 9 + [0, 5] + [3] * 20])
def test_vertices_are_those_of_plyfile(
    tmp_path: Path, rng: np.random.Generator, order: str, lengths: list[int]
) -> None:
    elements = mesh(rng, lengths)
    for given in (elements, elements[::-1]):
        plyfile.PlyData(given, text=not order, byte_order=order or "=", comments=["a b"]).write(
            tmp_path / "a.ply"
        )
        found, comments = read_vertices(tmp_path / "a.ply")
        assert comments == ["a b"]
        assert found.dtype.names == tuple(f"v{kind}" for kind in TYPES)
        for name in found.dtype.names:
            np.testing.assert_array_equal(found[name], elements[2].data[name])


@pytest.mark.parametrize(("name", "order"), [("binary_little_endian", "<"), ("binary_big_endian", ">")])
def test_lists_of_vertices_are_passed_over(tmp_path: Path, name: str, order: str) -> None:
    head = (
        f"ply\nformat {name} 1.0\nelement vertex 3\nproperty double x\nproperty list uchar short seen\n"
        "property int y\nend_header\n"
    )
    rows = [
        np.array(k + 0.5, f"{order}f8").tobytes()
        + bytes([k])
        + np.arange(k, dtype=f"{order}i2").tobytes()
        + np.array(-k, f"{order}i4").tobytes()
        for k in range(3)
    ]
    (tmp_path / "a.ply").write_bytes(head.encode() + b"".join(rows))
    found, _ = read_vertices(tmp_path / "a.ply")
    assert found.dtype.names == ("x", "y")
    assert found.tolist() == [(0.5, 0), (1.5, -1), (2.5, -2)]


def test_lists_of_vertices_in_text_are_passed_over(tmp_path: Path) -> None:
    text = HEAD.replace("double y", "list uchar int y") + "1 2 7 8 3\n4 0 6\n"
    (tmp_path / "a.ply").write_text(text)
    assert read_vertices(tmp_path / "a.ply")[0].tolist() == [(1.0, 3), (4.0, 6)]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_end_in_any_way(tmp_path: Path, end: str) -> None:
    (tmp_path / "a.ply").write_bytes((HEAD + ROWS).replace("\n", end).encode())
    vertices, comments = read_vertices(tmp_path / "a.ply")
    assert vertices.tolist() == [(1.0, 2.0, 3), (4.0, 5.0, 6)]
    assert comments == ["crs  EPSG:32608"]


def test_written_bytes_are_those_of_plyfile(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = mesh(rng, [3])[2].data
    comments = ["crs EPSG:32608", "vertical_datum EGM96"]
    write_vertices(tmp_path / "a.ply", rows, comments)
    element = plyfile.PlyElement.describe(rows, "vertex")
    plyfile.PlyData([element], text=False, byte_order="<", comments=comments).write(tmp_path / "b.ply")
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


@pytest.mark.parametrize(("name", "comment"), [("a b", ""), ("ä", ""), ("", ""), ("a", "ä"), ("a", "b\nc")])
def test_texts_that_no_header_can_hold_are_not_written(tmp_path: Path, name: str, comment: str) -> None:
    rows = np.zeros(1, [("x", "f8"), (name, "f8")] if name else [("x y", "f8")])
    with pytest.raises(PlyError):
        write_vertices(tmp_path / "a.ply", rows, [comment])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("ply\n", "", "line 1: expected 'ply'"),
        ("format ascii", "format binary", "line 2: don't understand format 'binary'"),
        ("1.0", "1.1", "line 2: expected version '1.0'"),
        ("format ascii 1.0\n", "", "line 2: expected"),
        ("vertex 2", "vertex two", "line 4: expected integer count"),
        ("vertex 2", "vertex -2", "line 4: expected integer count"),
        ("vertex 2", "vertex", "line 4: expected"),
        ("vertex 2", "point 2", "no element 'vertex'"),
        ("float x", "half x", "line 7: field type 'half'"),
        ("float x", "x", "line 7: expected"),
        ("double y", "double x", "two properties with same name"),
        ("obj_info", "object", "line 6: expected one of"),
        ("end_header\n", "", "early end-of-file"),
        ("EPSG", "Küste", "ascii"),
        (ROWS, "1 2 3\n", "element 'vertex': row 1: early end-of-file"),
        ("1 2 3", "1 2", "row 0: property 'z': early end-of-line"),
        ("4 5 6", "4 5 6 7", "row 1: expected end-of-line"),
        ("4 5 6", "", "row 1: property 'x': early end-of-line"),
        ("4 5 6", "4 b 6", "row 1: property 'y': malformed input"),
        ("4 5 6", "4 5 6.0", "row 1: property 'z': malformed input"),
        ("4 5 6", "4 5 256", "row 1: property 'z': malformed input"),
        ("4 5 6", "4 ä 6", "row 1: property 'y': malformed input"),
    ],
)
def test_faults_are_named_by_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert (HEAD + ROWS).count(old) == 1
    (tmp_path / "a.ply").write_text((HEAD + ROWS).replace(old, new), encoding="utf-8")
    with pytest.raises(PlyError, match=words):
        read_vertices(tmp_path / "a.ply")


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize("is_first", [True, False])
def test_no_part_of_a_file_passes_for_all_of_it(
    tmp_path: Path, rng: np.random.Generator, order: str, is_first: bool
) -> None:
    elements = mesh(rng, [3, 3, 4, 0, 3])[:: -1 if is_first else 1]
    file = tmp_path / "a.ply"
    plyfile.PlyData(elements, text=not order, byte_order=order or "=").write(file)
    content = file.read_bytes()
    n_ending = (
        0 if order else len("00\n")
    )  # a text may end without a line break, and in the middle of a number
    for n_bytes in {*range(0, len(content) - n_ending, 17), len(content) - n_ending - 1}:
        file.write_bytes(content[:n_bytes])
        with pytest.raises(PlyError):
            read_vertices(file)


def test_a_long_header_is_read(tmp_path: Path) -> None:
    text = (HEAD + ROWS).replace("comment of", "comment " + "long " * 40_000 + "\ncomment of")
    (tmp_path / "a.ply").write_text(text)
    assert len(read_vertices(tmp_path / "a.ply")[0]) == 2
    assert [prop.name for prop in read_header(tmp_path / "a.ply").elements[0].properties] == ["x", "y", "z"]


def test_many_rows_of_text_are_those_that_were_written(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = np.empty(70_000, [("x", "f4"), ("y", "f8"), ("n", "u4")])
    for name in rows.dtype.names:
        rows[name] = rng.uniform(0, 1e6, len(rows))
    plyfile.PlyData([plyfile.PlyElement.describe(rows, "vertex")], text=True).write(tmp_path / "a.ply")
    found: npt.NDArray[Any] = read_vertices(tmp_path / "a.ply")[0]
    stated = plyfile.PlyData.read(tmp_path / "a.ply")["vertex"].data
    assert found.tobytes() == stated.tobytes()


def test_a_file_without_points_is_refused_in_chunks(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(HEAD.replace("vertex 2", "vertex 0"))
    with pytest.raises(InputError, match="holds no points"):
        point_file_facts(tmp_path / "a.ply")


def test_text_is_read_in_chunks(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(HEAD + ROWS)
    assert point_file_facts(tmp_path / "a.ply").bounds == (1.0, 2.0, 4.0, 5.0)
    (chunk,) = ply_chunks(tmp_path / "a.ply", 1, 1, 10)
    assert chunk.xyz.tolist() == [[4.0, 5.0, 6.0]]
