"""Wrenches that belong to another robot, or that are only a share of what the load needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify
from tests.estimation.batch_team import held_recording
from tests.estimation.test_batch_judge import SEED, deviations, judged


@pytest.mark.parametrize("count", [2, 3])
def test_wrenches_of_two_robots_that_are_swapped_are_named_and_mended(count: int) -> None:
    right = held_recording(SEED, count)
    robots = dict(right.robots)
    robots["r1"] = replace(robots["r1"], wrench=right.robots["r2"].wrench)
    robots["r2"] = replace(robots["r2"], wrench=right.robots["r1"].wrench)
    recording = replace(right, robots=robots)
    _, verdict = judged(recording)
    assert (verdict.cause, verdict.robot) == ("robots swapped", None)
    assert "wrenches of r1 are those of r2" in verdict.words
    found = identify(recording, Options(assume="robots swapped"))
    assert found.doubts == ()
    assert deviations(recording, found).max() < 5.0


def test_a_dead_sensor_is_named_even_if_the_others_exert_what_a_lighter_load_needs() -> None:
    right = held_recording(SEED, 2)
    assert right.truth is not None
    adjoints = [(right.truth.poses[0].inverse() @ pose).adjoint() for pose in right.truth.poses]
    wrenches = right.stacked("wrench")
    total = np.sum([own @ adjoint.T for own, adjoint in zip(wrenches, adjoints, strict=True)], axis=0)
    noise = 1e-3 * np.random.default_rng(1).normal(size=total.shape)
    recording = right.changed("wrench", lambda _: noise, "r1")
    recording = recording.changed("wrench", lambda _: 0.4 * total @ np.linalg.inv(adjoints[1]).T, "r2")
    _, verdict = judged(recording)
    assert (verdict.cause, verdict.robot) == ("sensor dead", "r1"), verdict.words
