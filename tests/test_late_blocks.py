"""Blocks and messages that come too late are missing: that is said, and no sensor is suspected."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.app.run.overrides import override
from coheft.wire.scenario.file import load_scenario


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_a_late_block_is_not_called_a_sensor_s_fault(share: float) -> None:
    """From 3 s on r2 is so busy that it misses some of its blocks, and its neighbours some of its messages."""
    scenario = override(load_scenario("ring3"), duration=6.0, changes=())
    team, random = TeamInProcess(scenario), np.random.default_rng(5)
    start = round(3.0 / scenario.block_duration)
    reasons: set[str] = set()
    for block in range(scenario.blocks):
        readings, heard = measured(team.measure()), team.received()
        if block >= start:
            if random.random() < share:
                readings["r2"] = None
            for name in ("r1", "r3"):
                heard[name] = [each for each in heard[name] if each.sender != "r2" or random.random() >= share]
        for outbox in team.answer(readings, heard).values():
            if outbox.estimate is not None and block >= start:
                reasons.update(outbox.estimate.reasons)
    assert not [reason for reason in reasons if "sensor" in reason or "reads" in reason], reasons
    if share > 0.1:
        assert any("missing" in reason or "silent" in reason for reason in reasons), reasons
