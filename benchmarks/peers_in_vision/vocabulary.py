"""Vocabulary of ORB descriptors for ORB-SLAM3, whose package holds none.

Hierarchical k-majority clustering of the descriptors (Gálvez-López and Tardós, IEEE T-RO 28, 2012), written as DBoW2's text
file: branching and depth, then the parent, whether it is a word, 32 bytes and the weight of each node.
"""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from survey.core.streams import stream
from survey.data.frames import Image

BRANCHES, DEPTH = 5, 6
_N_FEATURES, _N_ROUNDS = 500, 5

Bits = npt.NDArray[np.float32]


def write_vocabulary(file: Path, images: Iterable[Image]) -> int:
    """Train a vocabulary on images; return its number of words."""
    orb = cv2.ORB_create(_N_FEATURES, fastThreshold=7)
    found = [orb.detectAndCompute(image, None)[1] for image in images]
    described = [one for one in found if one is not None]
    bits = np.unpackbits(np.vstack(described), axis=1).astype(np.float32)
    tree = _Tree(bits, np.repeat(np.arange(len(described)), [len(one) for one in described]))
    tree.split(np.arange(len(bits)), parent=0, level=0)
    file.write_text("\n".join([f"{BRANCHES} {DEPTH} 0 0", *tree.lines]), encoding="utf-8")
    return sum(line.split()[1] == "1" for line in tree.lines)


class _Tree:
    """Nodes of the tree over descriptors (N, 256) of the images `source` (N,), as lines of the file."""

    def __init__(self, bits: Bits, source: npt.NDArray[np.int_]) -> None:
        self.lines: list[str] = []
        self._bits, self._source, self._n_images = bits, source, int(source.max()) + 1

    def split(self, members: npt.NDArray[np.int_], parent: int, level: int) -> None:
        """Append the nodes below a parent: the clusters of its descriptors, each followed by its own."""
        label, centres = _clusters(self._bits[members])
        for k, centre in enumerate(centres):
            mine = members[label == k]
            is_word = level + 1 == DEPTH or len(mine) <= BRANCHES
            weight = np.log(self._n_images / len(np.unique(self._source[mine]))) if is_word else 0.0
            packed = " ".join(map(str, np.packbits(centre.astype(np.uint8)).tolist()))
            self.lines.append(f"{parent} {int(is_word)} {packed} {weight:.6f}")
            if not is_word:
                self.split(mine, len(self.lines), level + 1)


def _clusters(bits: Bits) -> tuple[npt.NDArray[np.int_], Bits]:
    """Return the cluster of each descriptor and the centres, the majority of each bit; empty clusters are left out."""
    distinct = np.unique(bits, axis=0)
    first = stream(0, "vocabulary", len(bits)).choice(
        len(distinct), min(BRANCHES, len(distinct)), replace=False
    )
    centres = distinct[first]
    for _ in range(_N_ROUNDS):
        # The Hamming distance is |a| + |b| - 2 a·b; |a| is the same for all centres.
        label = np.argmin(centres.sum(axis=1) - 2.0 * bits @ centres.T, axis=1)
        used, label = np.unique(label, return_inverse=True)
        centres = np.array([bits[label == k].mean(axis=0) >= 0.5 for k in range(len(used))], dtype=np.float32)
    return label, centres
