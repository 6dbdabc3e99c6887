"""A load that leaks while the robots weigh it: nothing that is estimated stays as it is."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
import pytest

from coheft.app.results.judge import Judge
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.structs import LoadChangeNotice, Validity
from coheft.wire.scenario.schema import LoadChange
from tests.in_process import changed, steps

LEAKING = LoadChange(at=5.0, mass=3.0, position=(-0.1, 0.15, 0.07), leak=0.1)
SETTLED = 7.0
"""From then on the drop itself is over, and 0.8 kg leak away until the end [s]."""


@dataclass(frozen=True, eq=False)
class Followed:
    """What three robots published after ``SETTLED``.

    Attributes:
        errors: Of the mass in valid estimates, against the truth of the same block, shape (n,) [kg].
        off: The largest error of each of them in its own standard deviations, poses included, shape (n,).
        notices: Of load changes, by robot.
        valid: Share of estimates that are valid.
    """

    errors: Array
    off: Array
    notices: dict[str, list[LoadChangeNotice]]
    valid: float


@pytest.fixture(scope="module")
def followed() -> Followed:
    sensors = msgspec.structs.replace(changed("ring3").sensors, rate=250)
    scenario = changed("ring3", seed=1, duration=15.0, sensors=sensors, load_changes=(LEAKING,))
    judge, errors, off, notices, reports = Judge(Simulation(scenario).scene), [], [], {}, 0
    for truth, outboxes in steps(scenario):
        judge.add(truth, remember=10)
        for name, outbox in outboxes.items():
            estimate = outbox.estimate
            if estimate is None:
                continue
            notices[name] = estimate.load_changes
            reports += estimate.time > SETTLED
            if estimate.time > SETTLED and estimate.status is Validity.VALID:
                errors.append(estimate.payload.mass - judge.payload(name, estimate.block).mass)
                off.append(max(stds.max(initial=0.0) for stds in judge.in_stds(estimate).values()))
    return Followed(np.array(errors), np.array(off), notices, len(errors) / reports)


def test_the_mass_follows_the_leak(followed: Followed) -> None:
    assert followed.valid > 0.9
    # All samples since the drop would give 0.3, what was dropped 0.6.
    assert np.sqrt(np.mean(np.square(followed.errors))) < 0.1


def test_the_drop_is_noticed_first_and_the_leak_again_and_again(followed: Followed) -> None:
    for notices in followed.notices.values():
        # What the robots feel at the drop itself is too sudden to be used; poses that are just new cost another block.
        assert notices[0].changed_at == pytest.approx(LEAKING.at, abs=0.1)
        assert notices[0].noticed_at < LEAKING.at + 0.5
        assert len(notices) > 3


def test_robots_know_how_far_off_they_are(followed: Followed) -> None:
    assert np.mean(followed.off > 5.0) < 0.01


@pytest.mark.slow
def test_only_the_newest_changes_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """A load that leaks for hours changes thousands of times, and messages would become too large."""
    monkeypatch.setattr("coheft.agents.efficient.estimator.MOST_NOTICES", 1)
    sensors = msgspec.structs.replace(changed("ring3").sensors, rate=250)
    leaking = msgspec.structs.replace(LEAKING, at=3.0)
    notices: list[LoadChangeNotice] = []
    for _, outboxes in steps(changed("ring3", seed=1, duration=8.0, sensors=sensors, load_changes=(leaking,))):
        if (estimate := outboxes["r1"].estimate) is not None:
            assert len(estimate.load_changes) <= 1
            notices = estimate.load_changes
    assert notices[0].changed_at > 3.5
