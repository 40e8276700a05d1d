import json
from pathlib import Path

import numpy as np
import pytest

from survey import InputError
from survey.core.documents import file_sha256, is_intact, read_manifest, with_checksum, write_manifest
from survey.core.run_folder import RunFolder

SHA = "0" * 64
GOOD = {
    "config_sha256": SHA,
    "seed": 1,
    "inputs_sha256": {"dem": SHA},
    "files_sha256": {"config.toml": SHA},
    "stages": {"plan": {"wall_s": 0.25, "files_sha256": {"route.geojson": SHA}}},
}


def without(key: str) -> dict:
    return {name: value for name, value in GOOD.items() if name != key}


def sealed(**changes: object) -> str:
    """A manifest whose checksum is right, so that only its shape can be refused."""
    return json.dumps(with_checksum({**GOOD, "manifest_version": 2, **changes}, "manifest_sha256"))


MALFORMED = {
    "empty": "",
    "half": sealed()[:100],
    "not JSON": "stages: plan",
    "a list": "[]",
    "a number": "1",
    "null": "null",
    "an empty object": "{}",
    "nested too deeply": "[" * 100_000,
    "not UTF-8": b"\xff\xfe{}",
    "no stages": json.dumps(with_checksum({**without("stages"), "manifest_version": 2}, "manifest_sha256")),
    "no inputs": json.dumps(
        with_checksum({**without("inputs_sha256"), "manifest_version": 2}, "manifest_sha256")
    ),
    "no checksum": json.dumps({**GOOD, "manifest_version": 2}),
    "no version": json.dumps(with_checksum(GOOD, "manifest_sha256")),
    "an older version": sealed(manifest_version=1),
    "a newer version": sealed(manifest_version=3),
    "a version that is text": sealed(manifest_version="2"),
    "stages that are a list": sealed(stages=["plan"]),
    "a stage that is text": sealed(stages={"plan": "done"}),
    "a stage without files": sealed(stages={"plan": {"wall_s": 1.0}}),
    "a time that is text": sealed(stages={"plan": {"wall_s": "1", "files_sha256": {}}}),
    "files that are numbers": sealed(stages={"plan": {"wall_s": 1.0, "files_sha256": {"a": 1}}}),
    "a checksum that is no checksum": sealed(config_sha256="xyz"),
    "an edited value": sealed().replace('"seed": 1', '"seed": 2'),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_a_malformed_manifest_is_refused_in_one_sentence(tmp_path, case):
    content = MALFORMED[case]
    (tmp_path / "manifest.json").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=r"^the manifest .*; run again with --fresh\.$") as caught:
        read_manifest(tmp_path / "manifest.json")
    assert "\n" not in str(caught.value)


def test_a_manifest_reads_as_it_was_written(tmp_path):
    write_manifest(tmp_path / "manifest.json", GOOD)
    content = read_manifest(tmp_path / "manifest.json")
    assert {key: content[key] for key in GOOD} == GOOD


def test_no_flipped_bit_of_a_manifest_reads_as_another_manifest(tmp_path):
    path = tmp_path / "manifest.json"
    write_manifest(path, GOOD)
    right, stored = read_manifest(path), path.read_bytes()
    for bit in np.random.default_rng(1).choice(8 * len(stored), 300, replace=False):
        damaged = bytearray(stored)
        damaged[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(bytes(damaged))
        try:
            assert read_manifest(path) == right
        except InputError:
            continue


def test_a_folder_with_a_malformed_manifest_is_found_and_then_refused(tmp_path):
    (tmp_path / "manifest.json").write_text("[]")
    with pytest.raises(InputError, match="manifest"):
        RunFolder.find(tmp_path).has("plan")


def test_a_checksum_covers_every_other_key():
    document = with_checksum({"a": 1, "b": [1.5, None]}, "sum")
    assert is_intact(document, "sum")
    assert not is_intact({**document, "a": 2}, "sum")
    assert not is_intact({**document, "c": 1}, "sum")
    assert not is_intact({"a": 1}, "sum")


def test_the_checksum_of_a_file_is_its_sha256(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    assert file_sha256(Path(tmp_path / "a")).startswith("ba7816bf8f01cfea")
