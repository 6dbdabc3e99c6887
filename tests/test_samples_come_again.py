"""With the first fit all samples come again: each counts once in the end, with poses that were not too rough."""

from __future__ import annotations

import pytest

from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import FaultSchedule
from tests.in_process import changed


@pytest.mark.parametrize("name", ["line4", "ring3"])
def test_poses_are_fitted_to_every_block_once(name: str) -> None:
    scenario = changed(name, duration=7.0, load_changes=())
    run = FaultyRun(FaultSchedule(seed=1, scenario=scenario, faults=()))
    for _ in run:
        pass
    for agent in run._agents.values():
        assert agent is not None
        team = agent._estimator._team  # type: ignore[attr-defined]
        moments = team._fits.common
        assert team._fits.again_before > moments._start
        count = moments.total.count + sum(each.count for each in moments._pending.values())
        blocks = 1 + team._completeness.newest
        # Two at a time follow: the very first block stays behind if they do not come out even.
        assert count / scenario.sensors.block in (blocks, blocks - 1)
