"""Loads that differ from the one before, where the offset of a sensor would explain the wrenches as well."""

from __future__ import annotations

import numpy as np

from coheft.agents.efficient.session import Session
from coheft.agents.efficient.stages import Stage
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.rows import ROW_SIZE, TORQUE
from tests.efficient.rows import made_up_rows
from tests.efficient.sessions import session

OFF_FROM, OFF_UNTIL = 60, 140


def rows_with_an_offset(size: float) -> Array:
    """The torque sensor of a robot has an offset [N·m] for a while."""
    rows = made_up_rows(420)
    rows[OFF_FROM:OFF_UNTIL, ROW_SIZE + TORQUE.start] += size
    return rows


def information_on_poses(found: Session) -> Array:
    """Prior information on all poses."""
    prior = found._known._chapter.prior
    assert prior is not None
    assert found.estimate is not None
    indices = found.estimate.body.unknowns.poses.ravel()
    return prior.evidence.information[np.ix_(indices, indices)]


def test_wrenches_that_a_faulty_sensor_may_have_measured_teach_no_poses() -> None:
    found, before = session(), np.zeros(0)
    for row in enumerate(rows_with_an_offset(0.3)):
        was_undecided = found.stage is Stage.UNDECIDED
        if was_undecided:
            before = information_on_poses(found)
        found.take(*row)
        if was_undecided and found.stage is Stage.GATHERING:
            break
    assert len(found.causes.changes) == 2
    np.testing.assert_allclose(information_on_poses(found), before, rtol=1e-6, atol=1e-6 * before.max())
