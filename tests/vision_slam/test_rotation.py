"""Products of quaternions against SciPy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vision_slam.attitude import chained, quaternion_products


def test_products_are_those_of_rotations() -> None:
    first, second = Rotation.random(20, random_state=1), Rotation.random(20, random_state=2)
    product = Rotation.from_quat(quaternion_products(first.as_quat(), second.as_quat()))
    assert ((first * second).inv() * product).magnitude() == pytest.approx(np.zeros(20), abs=1e-12)


@pytest.mark.parametrize("n", [1, 2, 7, 32])
def test_a_chain_is_the_product_in_order(n: int) -> None:
    turns = Rotation.random(n, random_state=3)
    expected = Rotation.identity()
    for turn in turns:
        expected = expected * turn
    assert (expected.inv() * Rotation.from_quat(chained(turns.as_quat()))).magnitude() < 1e-12
