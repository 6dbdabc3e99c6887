"""Which twists and accelerations of neighbours can be read."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.fan2017 import kinematics
from coheft.estimation.measurement import KINEMATICS, SAMPLE_SIZE


def test_none_and_those_of_a_block_can_be_read() -> None:
    assert kinematics.are_readable({}, 20)
    assert kinematics.are_readable({kinematics.CHANNEL: np.zeros((20, SAMPLE_SIZE))[:, KINEMATICS]}, 20)


@pytest.mark.parametrize("shape", [(19, 9), (20, 6), (9,), (20, 9, 1)])
def test_others_cannot(shape: tuple[int, ...]) -> None:
    assert not kinematics.are_readable({kinematics.CHANNEL: np.zeros(shape)}, 20)
