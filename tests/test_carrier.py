"""Robots that carry a load along a common path, with what they have found out about it."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from rich.console import Console

from coheft.agents.motion.carrier import Carrier
from coheft.agents.motion.common_path import CommonPath
from coheft.agents.motion.reference import make_motion
from coheft.app.results.carry_record import CarryRecord
from coheft.app.results.report import CarryReport
from coheft.app.run.inprocess import run_in_process
from coheft.app.run.overrides import override
from coheft.app.terminal.carry_table import print_carry
from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import ACCELERATION, SAMPLE_SIZE
from coheft.physics_server.simulation import Simulation
from coheft.wire.config import AgentConfig, agent_config
from coheft.wire.messages.structs import Estimate, PayloadEstimate, Validity
from coheft.wire.scenario.checks import check_scenario
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.motion import Carry
from coheft.wire.scenario.schema import LoadChange, Scenario

STILL = Carry(start=0.1, ramp=0.1, translation=(0.0,) * 3, rotation_deg=(0.0,) * 3, feedforward_at=0.0)
"""A path that goes nowhere."""
UP = np.array([0.0, 0.0, 9.81])
MIDDLE = (0.5, 0.0, 0.0)
"""Where a rod is held up without torques."""
GRASPS = {name: Pose(np.eye(3), np.array([x, 0.0, 0.0])) for name, x in (("r1", 0.0), ("r2", 1.0))}


def carrying(**changes: object) -> Scenario:
    """Three robots that carry their panel, and get a load of 2 kg on the way."""
    return msgspec.structs.replace(
        load_scenario("ring3"),
        carry=Carry(start=4.5, ramp=0.5, feedforward_at=6.5),
        load_changes=(LoadChange(at=9.5, mass=2.0, position=(-0.1, 0.15, 0.07)),),
        duration=12.5,
        **changes,
    )


def carried(scenario: Scenario) -> CarryReport:
    record = CarryRecord(scenario, Simulation(scenario).scene)
    for block in run_in_process(scenario):
        record.add(block.truth)
    return record.report()


@pytest.mark.slow
def test_a_load_that_is_known_is_carried_better_and_a_change_is_made_up_for() -> None:
    report = carried(carrying())
    alone, springs, before, after = report.phases
    assert [phase.what for phase in report.phases] == ["alone", "springs", "feedforward", "feedforward"]
    assert springs.position_rms_mm is not None
    assert springs.rotation_rms_deg is not None
    for phase in (before, after):
        assert phase.position_rms_mm is not None
        assert phase.rotation_rms_deg is not None
        assert 40.0 * phase.position_rms_mm < springs.position_rms_mm
        assert 5.0 * phase.rotation_rms_deg < springs.rotation_rms_deg
        assert phase.internal_force_rms_n < springs.internal_force_rms_n < 0.2 * alone.internal_force_rms_n
    (drop,) = report.drops
    assert drop.back_after_s is not None
    assert drop.back_after_s < 1.3


def test_a_load_that_came_before_the_path_is_judged_on_the_path_only(capsys: pytest.CaptureFixture[str]) -> None:
    """Until there is one, each robot moves as it likes."""
    early = LoadChange(at=3.0, mass=2.0, position=(-0.1, 0.15, 0.07))
    report = carried(msgspec.structs.replace(carrying(), load_changes=(early,), duration=9.0))
    springs = next(phase for phase in report.phases if phase.what == "springs")
    (drop,) = report.drops
    assert springs.position_rms_mm is not None
    assert springs.position_rms_mm < drop.largest_mm < 2.0 * springs.position_rms_mm
    print_carry(Console(width=200), report)
    assert f"back on it after {drop.back_after_s:.1f} s" in capsys.readouterr().out
    print_carry(Console(width=200), msgspec.structs.replace(report, phases=[springs]))
    assert "back on it" not in capsys.readouterr().out  # no one has promised that springs alone do it


def settings(carry: Carry) -> AgentConfig:
    return agent_config(msgspec.structs.replace(load_scenario("ring3"), carry=carry), "r1", ("r2", "r3"))


def estimate(
    config: AgentConfig, mass: float, deviations: Array, status: str, com: tuple[float, float, float]
) -> Estimate:
    payload = PayloadEstimate(mass, np.array(com), np.eye(3), np.diag(deviations**2))
    return msgspec.convert(
        {
            "robot": config.name, "block": 0, "time": 0.1, "phase": "inertia", "converged": True, "members": 2,
            "payload": payload, "poses": {}, "total_block": 0, "total_wrench": np.zeros(6), "not_observable": [],
            "load_changes": [], "status": status,
        },
        Estimate,
    )  # fmt: skip


class Arm:
    """A robot at rest, which is told what it knows before every block, from one of them on."""

    def __init__(self, carry: Carry = STILL, up: Array = UP, index: int = 0) -> None:
        self.config = settings(carry)
        alone = make_motion(self.config)
        self._carrier = Carrier(self.config, carry, alone)
        self._samples = np.zeros((self.config.block, SAMPLE_SIZE))
        self._samples[:, ACCELERATION] = up
        self._index = index

    def push(
        self,
        mass: float,
        deviation: float | Array = 1e-3,
        status: str = "valid",
        blocks: int = 100,
        com: tuple[float, float, float] = MIDDLE,
    ) -> Array:
        """The wrench after so many blocks."""
        deviations = np.broadcast_to(deviation, 10)
        for _ in range(blocks):
            self._carrier.learn(self._index, estimate(self.config, mass, deviations, status, com), GRASPS)
            _, wrench = self._carrier.step(self._index, self._samples)
            self._index += 1
        return wrench


def test_two_robots_at_a_rod_hold_half_of_it_each() -> None:
    np.testing.assert_allclose(Arm().push(8.0), [0.0, 0.0, 4.0 * 9.81, 0.0, 0.0, 0.0], atol=0.01)


def test_what_is_not_known_well_is_not_used() -> None:
    np.testing.assert_array_equal(Arm().push(8.0, deviation=1.0), 0.0)
    np.testing.assert_array_equal(Arm().push(8.0, status=Validity.STARTING), 0.0)


@pytest.mark.parametrize(("axis", "is_used"), [(1, True), (2, False)])
def test_what_is_not_known_along_gravity_does_not_matter_however_the_load_lies(axis: int, is_used: bool) -> None:
    """At a quarter of the path's long period the load lies on its side."""
    aside = msgspec.structs.replace(STILL, rotation_deg=(90.0, 0.0, 0.0), rotation_period=(100.0, 1.0, 1.0))
    index = settings(aside).blocks(STILL.start + 25.0)
    deviations = np.full(10, 1e-3)
    deviations[1 + axis] = 0.1
    wrench = Arm(aside, up=np.array([0.0, 9.81, 0.0]), index=index).push(8.0, deviation=deviations)
    expected = 4.0 * 9.81 if is_used else 0.0
    np.testing.assert_allclose(wrench[:3], [0.0, expected, 0.0], atol=0.5)


def test_the_last_good_estimate_stays() -> None:
    arm = Arm()
    good = arm.push(8.0)
    np.testing.assert_allclose(arm.push(3.0, status=Validity.STALE), good, atol=0.01)
    np.testing.assert_allclose(arm.push(3.0, deviation=1.0), good, atol=0.01)
    np.testing.assert_allclose(arm.push(10.0), 1.25 * good, atol=0.02)


def test_no_arm_pushes_more_than_it_can() -> None:
    wrench = Arm(msgspec.structs.replace(STILL, force_limit=7.0)).push(8.0)
    assert np.linalg.norm(wrench[:3]) == pytest.approx(7.0)


def test_an_arm_that_cannot_turn_harder_pushes_less_as_a_whole() -> None:
    aside = (0.5, 0.2, 0.0)
    wanted = Arm().push(8.0, com=aside)
    assert np.linalg.norm(wanted[3:]) == pytest.approx(4.0 * 9.81 * 0.2, rel=0.01)
    wrench = Arm(msgspec.structs.replace(STILL, torque_limit=2.0)).push(8.0, com=aside)
    assert np.linalg.norm(wrench[3:]) == pytest.approx(2.0)
    np.testing.assert_allclose(wrench, 2.0 / np.linalg.norm(wanted[3:]) * wanted, atol=1e-9)


def test_a_new_estimate_takes_the_place_of_the_old_one_soon_and_without_a_jump() -> None:
    arm = Arm()
    before = arm.push(8.0)
    wrenches = np.array([before, *(arm.push(10.0, blocks=1) for _ in range(100))])
    change = np.linalg.norm(wrenches[-1] - before)
    assert change == pytest.approx(9.81, rel=0.01)
    steps = np.linalg.norm(np.diff(wrenches, axis=0), axis=1)
    assert steps.max() < 0.25 * change
    soon = arm.config.blocks(0.1)
    assert np.linalg.norm(wrenches[-1] - wrenches[soon]) < 0.5 * change
    assert np.linalg.norm(wrenches[-1] - wrenches[3 * soon]) < 0.1 * change


def test_without_feedforward_no_arm_pushes() -> None:
    np.testing.assert_array_equal(Arm(msgspec.structs.replace(STILL, feedforward=False)).push(8.0), 0.0)


def test_the_path_starts_at_rest_and_its_rates_are_the_derivatives() -> None:
    path = CommonPath(Carry(start=1.0, ramp=2.0), 1.5)
    time = np.arange(0.0, 6.0, 1e-4)
    displacement, rate = path.displacement(time)
    np.testing.assert_array_equal(displacement[time < 1.5], 0.0)
    np.testing.assert_allclose(rate[1:-1], (displacement[2:] - displacement[:-2]) / 2e-4, atol=1e-6)


def test_who_starts_later_gets_to_the_same_place() -> None:
    late = np.array([20.0])
    one, other = (CommonPath(Carry(start=1.0), start).displacement(late) for start in (1.0, 9.0))
    np.testing.assert_array_equal(one, other)


def test_a_path_needs_the_whole_teams_poses_and_arms_that_can_turn() -> None:
    with pytest.raises(ScenarioError, match=r"'carry'.*'fan2017', expected 'efficient'"):
        check_scenario(carrying(estimator="fan2017"), "x.toml")
    gimbals = msgspec.structs.replace(load_scenario("mocobot_a"), carry=Carry())
    with pytest.raises(ScenarioError, match=r"'carry'.*gimbals"):
        check_scenario(gimbals, "x.toml")


def test_feedforward_is_switched_where_there_is_a_path_only() -> None:
    assert not override(carrying(), feedforward=False).carry.feedforward  # type: ignore[union-attr]
    with pytest.raises(ScenarioError, match=r"'ring6'.*carry6"):
        override(load_scenario("ring6"), feedforward=False)
