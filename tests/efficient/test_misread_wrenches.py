"""Robots whose drivers give wrenches with another sign, or in other units."""

from __future__ import annotations

from collections.abc import Collection

import msgspec
import numpy as np
import pytest

from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.estimation.measurement import WRENCH, MeasurementBlock
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.file import load_scenario

FORCE, TORQUE = slice(WRENCH.start, WRENCH.start + 3), slice(WRENCH.start + 3, WRENCH.stop)


def said(
    robots: Collection[str], columns: slice = WRENCH, factor: float = 1.0, offset: float = 0.0, until: int = 150
) -> dict[str, Estimate]:
    """The estimates of three robots after so many blocks if these robots' readings have a factor and an offset."""
    shipped = load_scenario("ring3")
    sensors = msgspec.structs.replace(shipped.sensors, rate=500, block=10)
    team = TeamInProcess(msgspec.structs.replace(shipped, load_changes=(), sensors=sensors))
    found: dict[str, Estimate] = {}
    while team.simulation.block < until:
        blocks = dict(measured(team.measure()))
        for name in robots:
            samples = np.array(blocks[name].samples)
            samples[:, columns] = factor * samples[:, columns] + offset
            blocks[name] = MeasurementBlock(blocks[name].index, samples)
        outboxes = team.answer(blocks, team.received())
        found |= {name: outbox.estimate for name, outbox in outboxes.items() if outbox.estimate is not None}
    return found


def test_a_robot_whose_wrenches_have_the_opposite_sign_is_named_by_all() -> None:
    """Not the motion, which they make seem wrong: wrenches that fit no load make poses wrong."""
    for estimate in said({"r2"}, factor=-1.0).values():
        assert estimate.status == "starting"
        (reason,) = estimate.reasons
        assert "would if those of r2 had the opposite sign" in reason


@pytest.mark.parametrize("offset", [0.5, 30.0])
def test_a_sensor_that_has_not_been_tared_is_told_by_all(offset: float) -> None:
    """Whose it is cannot be known: an offset of any robot is one of the sum."""
    for estimate in said({"r2"}, FORCE, offset=offset).values():
        assert estimate.status == "starting"
        (reason,) = estimate.reasons
        assert reason.endswith("has a sensor not been tared?")


def test_if_all_have_the_opposite_sign_the_load_seems_to_weigh_less_than_nothing() -> None:
    for estimate in said({"r1", "r2", "r3"}, factor=-1.0).values():
        assert estimate.payload is None
        assert estimate.reasons[0].startswith("mass: wrenches show -5")


def test_a_robot_that_uses_none_of_its_samples_is_missed_by_all() -> None:
    """As its torques are in N·mm, they seem to jump."""
    found = said({"r2"}, TORQUE, factor=1000.0)
    assert "own sensors: the torque has outliers" in found["r2"].reasons
    for estimate in found.values():
        assert any(reason.startswith("measurements of r2 are missing since") for reason in estimate.reasons)


def test_poses_that_these_wrenches_have_moved_far_do_not_make_the_motion_seem_wrong() -> None:
    """A fit to the motion that begins at them does not converge, and another robot's sensors seem to be off."""
    for estimate in said({"r2"}, FORCE, factor=-1.0, until=80).values():
        (reason,) = estimate.reasons
        assert "would if those of r2 had forces of the opposite sign" in reason
