"""Step by step, with a caller's own code between blocks."""

from __future__ import annotations

import matplotlib
import pytest

import coheft
from coheft.errors import CoheftError, LoadError, SimulationError

matplotlib.use("agg")


def test_time_goes_on_by_blocks():
    simulation = coheft.simulate("ring3")
    assert (simulation.time, simulation.estimates, simulation.is_over) == (0.0, {}, False)
    simulation.step(5)
    assert simulation.time == pytest.approx(5 * simulation.scenario.block_duration)
    simulation.run_until(0.5)
    assert simulation.time == pytest.approx(0.5)
    assert set(simulation.estimates) == set(simulation.robots)


def test_there_is_no_result_before_robots_have_spoken():
    simulation = coheft.simulate("ring3")
    with pytest.raises(CoheftError, match="no result before all robots have published"):
        simulation.result()


def test_a_load_that_is_put_on_is_weighed():
    simulation = coheft.simulate("ring3")
    simulation.run_until(1.0)
    load = simulation.inject(mass=2.0, at=(0.1, 0.0, 0.1))
    simulation.run_until(2.5)
    assert simulation.truth.payload.mass == pytest.approx(7.0)
    assert simulation.estimates["r1"].payload.mass == pytest.approx(7.0, abs=0.2)
    simulation.remove(load)
    simulation.run_until(3.0)
    result = simulation.result()
    assert [change.truth.mass for change in result.load_changes] == pytest.approx([7.0, 5.0])
    with pytest.raises(LoadError):
        simulation.remove(load)


def test_neighbours_do_not_hear_each_other_over_a_cut_link():
    simulation = coheft.simulate("ring3")
    simulation.run_until(1.0)
    simulation.cut("r2", "r1")
    simulation.run_until(1.3)
    assert simulation.estimates["r1"].silent == ["r2"]
    assert simulation.estimates["r2"].silent == ["r1"]
    assert simulation.estimates["r3"].silent == []
    lengths = [len(robot.time) for robot in simulation.result().robots.values()]
    assert len(set(lengths)) > 1, "doubts are told at once, so some robots have said more than others"
    assert len(simulation.result().plot()) == 3
    simulation.mend("r1", "r2")
    simulation.run_until(1.6)
    assert simulation.estimates["r1"].silent == []


def test_a_robot_that_lets_go_says_so():
    simulation = coheft.simulate("ring6")
    simulation.run_until(0.5)
    simulation.release("r2")
    simulation.run_until(0.8)
    assert "the robot does not hold the load" in simulation.estimates["r2"].reasons
    simulation.grasp("r2")
    simulation.run_until(1.2)
    assert "the robot does not hold the load" not in simulation.estimates["r2"].reasons


def test_what_there_is_not_is_refused():
    simulation = coheft.simulate("ring6")
    with pytest.raises(CoheftError, match=r"there is no link r1-r3; the links are r1-r2"):
        simulation.cut("r1", "r3")
    with pytest.raises(SimulationError, match="there is no robot r9"):
        simulation.release("r9")
