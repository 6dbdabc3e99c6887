"""Knowledge whose wrenches fit no load: it is judged by motion alone, and what would make them fit is looked for."""

from __future__ import annotations

from coheft.agents.efficient.judge import Outcome
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import FORCE, ROW_SIZE, RowNoise
from tests.efficient.rows import PERIOD, POSES, made_up_rows

SETTINGS = FitSettings(RowNoise.of_samples(SensorNoise(), 20, 1000.0), PERIOD)


def with_offset(rows: Array) -> Array:
    """Rows in which a force of the third robot is 20 N too large."""
    rows[:, ROW_SIZE * 2 + FORCE.start] += 20.0
    return rows


def knowledge(rows: Array) -> Knowledge:
    known = Knowledge(len(POSES), 0, SETTINGS, Guards())
    for number, row in enumerate(rows):
        known.buffer.add(number, row)
    return known


def test_what_would_make_wrenches_fit_is_told_once_there_are_rows_enough() -> None:
    for count, is_told in ((60, True), (20, False)):
        known = knowledge(with_offset(made_up_rows(count)))
        assert known.judge_by_motion().outcome is Outcome.NO_LOAD
        assert (known.misreading() is not None) == is_told


def test_while_poses_are_unknown_nothing_is_told() -> None:
    known = knowledge(with_offset(made_up_rows(60, axes=(1.0, 0.0, 0.0))))
    known.judge_by_motion()
    assert known.misses_poses
    assert known.misreading() is None
