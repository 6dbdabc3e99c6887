"""How often rows are asked for errors that no robot was told of, and for how long an answer lasts."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from coheft.agents.efficient.acceptance import UndeclaredWatch
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import FORCE, ROW_SIZE, RowNoise
from coheft.estimation.moments.undeclared import UndeclaredError
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows
from tests.estimation.moments.fitting import IDEAL
from tests.estimation.moments.moving_team import make_team

ROWS = made_up_rows(700)
SETTINGS = FitSettings(RowNoise.of_samples(SensorNoise(), 20, 1000.0), PERIOD)
FOUND = UndeclaredError(1, "acceleration_scale", 2.0)


def fed(
    monkeypatch: pytest.MonkeyPatch, guards: Guards, asked_for: range, size: float = 2.0
) -> tuple[list[int], list[int], list[int]]:
    """Rows at which a session looks for such errors, after which one is told, and after which one is suspected, if
    rows ask for it at some rows.
    """
    looks, told, suspected, now = list[int](), list[int](), list[int](), [0]

    def undeclared_error(self: Knowledge) -> UndeclaredError | None:
        looks.append(now[0])
        return FOUND._replace(size=size) if now[0] in asked_for else None

    monkeypatch.setattr(Knowledge, "undeclared_error", undeclared_error)
    session = Session(len(POSES), 0, SETTINGS, guards)
    for number, row in enumerate(ROWS):
        now[0] = number
        session.take(number, row)
        if session.undeclared is not None:
            told.append(number)
        if session.suspected is not None:
            suspected.append(number)
    return looks, told, suspected


def fed_with_another_load(now: list[int]) -> Session:
    """A session after 400 rows of one load and 60 of another; ``now`` is the number of the present row."""
    session = Session(len(POSES), 0, SETTINGS, Guards())
    for number, row in enumerate(np.concatenate([made_up_rows(400), made_up_rows(60, 1.3 * LOAD, first=400)])):
        now[0] = number
        session.take(number, row)
    return session


def test_looks_become_rarer_as_rows_become_many(monkeypatch: pytest.MonkeyPatch) -> None:
    looks, _, _ = fed(monkeypatch, Guards(), range(0))
    assert len(looks) < 15
    assert all(later > 1.3 * earlier for earlier, later in pairwise(looks))


def test_an_error_is_suspected_before_there_are_enough_rows_to_find_it(monkeypatch: pytest.MonkeyPatch) -> None:
    looks, told, suspected = fed(monkeypatch, Guards(), range(700))
    assert suspected[0] == looks[0] < 32
    assert 45 < told[0] < 60
    assert told[-1] == len(ROWS) - 1


@pytest.mark.parametrize(("size", "is_suspected"), [(0.5, False), (0.7, True)])
def test_a_weak_error_is_only_suspected(monkeypatch: pytest.MonkeyPatch, size: float, is_suspected: bool) -> None:
    looks, told, suspected = fed(monkeypatch, Guards(), range(300), size)
    assert not told
    assert bool(suspected) == is_suspected
    if is_suspected:
        assert max(suspected) < 350  # until the rows do not ask for it any more
        assert len(looks) > 15  # at every fit


def test_another_load_is_tested_at_its_first_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    looks, now = list[int](), [0]
    monkeypatch.setattr(Knowledge, "undeclared_error", lambda _: looks.append(now[0]))
    found = fed_with_another_load(now)
    assert found.causes.changes
    assert any(400 < look < 450 for look in looks)


def test_what_is_suspected_is_not_handed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Knowledge, "undeclared_error", lambda _: FOUND._replace(size=0.7))
    session = Session(len(POSES), 0, SETTINGS, Guards())
    for number, row in enumerate(ROWS[:100]):
        session.take(number, row)
    assert session.suspected is not None
    assert session.hand_over(0.0) is None


def test_an_error_is_over_also_if_fits_are_to_fewer_rows_than_it_was_found_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where sensors drift, rows become part of a prior again and again."""
    session, watch = Session(len(POSES), 0, SETTINGS, Guards()), UndeclaredWatch(0.6, 1.3, lasts=1000)
    for number, row in enumerate(ROWS[:100]):
        session.take(number, row)
    known = session._known
    monkeypatch.setattr(Knowledge, "undeclared_error", lambda _: FOUND)
    assert [watch.test(known) for _ in range(2)] == [False, True]
    monkeypatch.setattr(Knowledge, "undeclared_error", lambda _: None)
    known._end_page()
    assert known.buffer.load_rows < 10
    for number, row in enumerate(ROWS[100:150], 100):
        known.buffer.add(number, row)
    watch.test(known)
    assert watch.found is None


def test_in_a_large_team_an_offset_of_forces_is_found() -> None:
    team = make_team(4, count=13, number=60)
    rows = team.noisy(np.random.default_rng(4))
    rows[:, 2 * ROW_SIZE + FORCE.start] += 0.5
    session = Session(13, 0, IDEAL, Guards())
    for number, row in enumerate(rows):
        session.take(number, row)
    assert session.suspected is not None
    assert (session.suspected.robot, session.suspected.kind) == (2, "force_bias")
