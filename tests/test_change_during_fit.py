"""The load changes while a fit of the poses is under way: what was known of it before is told no longer."""

from __future__ import annotations

import numpy as np

from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import FaultSchedule
from tests.in_process import changed


def test_a_load_of_before_its_change_is_not_told_while_poses_are_fitted() -> None:
    run = FaultyRun(FaultSchedule(seed=1, scenario=changed("ring3", duration=5.0, load_changes=()), faults=()))
    for _ in run:
        pass
    for agent in run._agents.values():
        assert agent is not None
        team = agent._estimator._team  # type: ignore[attr-defined]
        # New poses are in use that matter, and nobody has told yet how its wrench followed from the motion.
        team._found_before, team._corrected, team._largest_step = team.found(), -1, np.inf
        assert team.found().payload is not None
        assert team._memory.adopt(team._completeness.newest - 3)  # as when a neighbour has noticed it
        assert team.found().payload is None
