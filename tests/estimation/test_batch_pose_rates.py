"""Recordings with poses and twists: angular velocities have to be the rates of the poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.drawn_recordings import draw_team, recorded
from coheft.errors import RecordingError
from coheft.estimation.batch.plausibility import plausible_signals
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF


@pytest.fixture(scope="module")
def both() -> Recording:
    team = draw_team(3)
    twists, poses = (recorded(team, "white", by_twists=by_twists) for by_twists in (True, False))
    robots = {name: replace(robot, pose=poses.robots[name].pose) for name, robot in twists.robots.items()}
    return replace(twists, robots=robots)


def test_right_ones_are_accepted(both: Recording) -> None:
    plausible_signals(both, CUTOFF)


@pytest.mark.parametrize("who", [None, "r2"])
def test_another_unit_is_named(who: str | None, both: Recording) -> None:
    turns = both.changed("twist", lambda twist: twist * np.repeat([60.0 / (2.0 * np.pi), 1.0], 3), who)
    names = "r2" if who else ", ".join(both.names)
    with pytest.raises(RecordingError, match=rf"'twist' of {names}: angular velocities are 9\.\d+ times those of the"):
        plausible_signals(turns, CUTOFF)


def test_the_opposite_sign_is_no_other_unit(both: Recording) -> None:
    opposite = both.changed("twist", lambda twist: twist * np.repeat([-1.0, 1.0], 3), "r2")
    with pytest.raises(RecordingError, match="'twist' of r2: angular velocities have the opposite sign of those of"):
        plausible_signals(opposite, CUTOFF)


def test_times_in_another_unit_than_twists_are_named(both: Recording) -> None:
    robots = {name: replace(robot, time=2.0 * robot.time) for name, robot in both.robots.items()}
    with pytest.raises(RecordingError, match=r"times those of the poses: .* times in seconds"):
        plausible_signals(replace(both, robots=robots), CUTOFF)


def test_axes_of_the_home_frame_are_named(both: Recording) -> None:
    robots = dict(both.robots)
    for name, robot in robots.items():
        assert robot.pose is not None
        assert robot.twist is not None
        turn = Rotation.from_quat(robot.pose[:, 3:])
        robots[name] = replace(robot, twist=np.hstack([turn.apply(robot.twist[:, :3]), turn.apply(robot.twist[:, 3:])]))
    with pytest.raises(RecordingError, match="the poses in the axes of the home frame: give twists in"):
        plausible_signals(replace(both, robots=robots), CUTOFF)


def test_other_rotations_are_left_to_the_judge(both: Recording) -> None:
    """They may be those of a gyro that is mounted otherwise."""
    plausible_signals(both.changed("twist", lambda twist: twist[:, [1, 2, 0, 4, 5, 3]], "r2"), CUTOFF)
