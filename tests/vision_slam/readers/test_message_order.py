"""Repeated and late messages are left out; times of a clock that was set back are not."""

from vision_slam.readers.bags import in_order


def test_times_that_go_back_often_are_not_mended() -> None:
    assert in_order([1.0, 2.0, 2.0, 3.0]).tolist() == [True, True, False, True]
    assert in_order([9.0, 1.0, 2.0, 3.0]).all()
    assert in_order([]).tolist() == []
