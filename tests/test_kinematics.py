"""Which twists and accelerations of neighbours the estimator ``fan2017`` can read."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.fan2017.estimator import Fan2017Estimator
from coheft.consensus.gossip import Gossip
from coheft.estimation.measurement import KINEMATICS, SAMPLE_SIZE
from coheft.wire.config import agent_config
from tests.in_process import changed

CONFIG = agent_config(changed("ring3"), "r1", ("r2", "r3"))
ESTIMATOR = Fan2017Estimator(CONFIG, Gossip("r1", ("r2", "r3")))


def test_none_and_those_of_a_block_can_be_read() -> None:
    assert ESTIMATOR.fits({})
    assert ESTIMATOR.fits({"kinematics": np.zeros((CONFIG.block, SAMPLE_SIZE))[:, KINEMATICS]})


@pytest.mark.parametrize("shape", [(CONFIG.block - 1, 9), (CONFIG.block, 6), (9,), (CONFIG.block, 9, 1)])
def test_others_cannot(shape: tuple[int, ...]) -> None:
    assert not ESTIMATOR.fits({"kinematics": np.zeros(shape)})
