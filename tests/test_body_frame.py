"""A robot comes to know its pose in the team's body frame, and need not find it again when others come and go."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest

from agents.known_pose import KnownPose
from coheft.estimation.measurement import KINEMATICS
from coheft.estimation.spatial import Array, Pose
from tests.body_frame_team import DEVIATIONS, ENOUGH, NAMES, SIZE, Team, others_than

CLOSE = 0.1
"""As well as poses have to be known at first [rad, m]."""
ROUNDING = 1e-12
KEPT = np.tile([0.0, *KnownPose(Pose.identity()).numbers()], (3, 1))
"""What a neighbour may tell."""


@cache
def assembled() -> Team:
    result = Team()
    result.begin_sums(result.assemble())
    return result


@pytest.fixture
def team() -> Team:
    """One whose sums have begun."""
    return deepcopy(assembled())


def test_at_first_everybody_finds_its_pose_from_neighbour_to_neighbour() -> None:
    team = Team()
    poses = team.assemble()
    assert team.distance(poses["r1"], Pose.identity()) == 0.0
    team.begin_sums(poses)
    for name in NAMES:
        assert team.distance(poses[name], team.exact[name]) < CLOSE
    seen = team.robots["r2"].frame.neighbours_poses()
    assert set(seen) == {"r1", "r3"}
    for name, estimate in seen.items():
        assert team.distance(estimate.pose, team.true_pose("r2", name)) < CLOSE
        assert not estimate.unseen


def test_nobody_guesses_a_pose_before_it_has_been_seen() -> None:
    team = Team()
    team.run(11)
    assert team.robots["r1"].pose() is not None  # that of the frame itself
    assert all(team.robots[name].pose() is None for name in others_than("r1"))


@pytest.mark.parametrize("name", NAMES)
def test_who_starts_again_is_told_its_pose(team: Team, name: str) -> None:
    """The reference robot as well: the frame stays where it was."""
    team.restart(name)
    team.run(1)
    team.dissolve(others_than(name))
    poses = team.assemble(10)  # far too few to find any
    assert team.robots["r1"].gossip.frame() == team.number
    for other in NAMES:
        assert team.distance(poses[other], team.exact[other]) < ROUNDING
        assert team.robots["r2"].gossip.deviations(other) == tuple(DEVIATIONS.get(other, ()))


def test_who_has_no_neighbour_that_knows_its_pose_finds_it_in_the_same_frame(team: Team) -> None:
    for name in ("r3", "r4"):
        team.restart(name)
    team.run(1)
    team.dissolve(("r1", "r2"))
    poses = team.assemble()
    assert team.robots["r1"].gossip.frame() == team.number
    for name in ("r1", "r2", "r3"):
        assert team.distance(poses[name], team.exact[name]) < ROUNDING
    assert ROUNDING < team.distance(poses["r4"], team.exact["r4"]) < CLOSE
    assert [name for name in NAMES if team.robots["r1"].gossip.deviations(name)] == ["r1", "r2", "r3"]


def test_when_all_start_again_it_is_another_frame(team: Team) -> None:
    for name in NAMES:
        team.restart(name)
    poses = team.assemble()
    assert team.robots["r1"].gossip.frame() != team.number
    for name in NAMES:
        assert team.distance(poses[name], team.exact[name]) < CLOSE


def test_those_who_hold_on_keep_their_poses_and_who_takes_hold_elsewhere_finds_its_new_one(team: Team) -> None:
    team.robots["r4"].gossip.announce_holding(False, team.block)
    team.grasps["r4"] = None
    team.run(3)
    team.dissolve()
    poses = team.assemble(10)
    assert poses.keys() == {"r1", "r2", "r3"}
    for name, pose in poses.items():
        assert team.distance(pose, team.exact[name]) < ROUNDING

    team.begin_sums(poses)
    team.robots["r4"].gossip.announce_holding(True, team.block + 10)  # told ahead: the arm waits still
    team.run(3)
    team.dissolve(("r1", "r2", "r3"))
    team.run(7)
    team.take_hold("r4")
    poses = team.assemble()
    assert team.robots["r1"].gossip.frame() == team.number
    for name in ("r1", "r2", "r3"):
        assert team.distance(poses[name], team.exact[name]) < ROUNDING
    assert team.distance(poses["r4"], team.true_pose("r1", "r4")) < CLOSE


def test_a_robot_that_let_go_and_took_hold_while_nobody_heard_it_is_not_taken_to_be_where_it_was(team: Team) -> None:
    team.robots["r4"].gossip.announce_holding(False, team.block)
    team.grasps["r4"] = None
    team.run(3, cut_off="r4")
    team.robots["r4"].gossip.announce_holding(True, team.block)
    team.take_hold("r4")
    team.run(3, cut_off="r4")
    team.dissolve(("r4",))
    team.run(3)
    team.dissolve(("r1", "r2", "r3"))
    poses = team.assemble()
    assert team.distance(poses["r4"], team.true_pose("r1", "r4")) < CLOSE


@pytest.mark.parametrize(
    "nonsense",
    [
        {"kept_frame": np.array([1.0])},
        {"kept_poses": KEPT[:2]},
        {"kept_frame": np.array([1.0, 2.0]), "kept_poses": KEPT[:2]},
        {"kept_frame": np.array([1.0]), "kept_poses": KEPT},
        {"kept_frame": np.array([1.0]), "kept_poses": KEPT[:2, :-1]},
        {"kept_frame": np.array([1.0]), "kept_poses": np.zeros((2, 19))},
        {"kept_frame": np.array([1.0]), "kept_poses": np.ones((2, 19))},
        {"kept_frame": np.array([0.0]), "kept_poses": KEPT[:2]},
        {"kept_frame": np.array([1.0]), "kept_poses": KEPT[:2]},  # not the frame of this team
        {"kinematics": np.ones((SIZE + 1, 9))},
    ],
)
def test_nonsense_teaches_nobody_a_pose(nonsense: dict[str, Array]) -> None:
    team = Team()
    team.run(3)
    robot = team.robots["r3"]
    robot.frame.hear_kept_poses({"r2": nonsense})
    robot.frame.update_pairs(team.block - 1, robot.samples, {"r2": nonsense})
    assert robot.frame.kept_pose() is None
    assert robot.frame.found_pose() is None


@pytest.mark.parametrize("spoil", ["no rotation", "too few", "too many", "too narrow", "a row alone", "no frame"])
def test_what_is_no_pose_is_not_taken_for_one(team: Team, spoil: str) -> None:
    team.restart("r4")
    team.run(1)
    team.dissolve(others_than("r4"))
    team.run(3)
    robot = team.robots["r4"]
    told = robot.frame.kept_pose()
    assert told is not None
    frame = np.array([float(told[1])])
    rows = np.tile([robot.gossip.own.since, *KnownPose(Pose.identity()).numbers()], (2, 1))
    wrong = {
        "no rotation": (frame, np.where(np.arange(19) > 0, 1.0, rows)),
        "too few": (frame, rows[:1]),
        "too many": (frame, np.vstack([rows, rows])),
        "too narrow": (frame, rows[:, :-1]),
        "a row alone": (frame, rows[0]),
        "no frame": (np.zeros(0), rows),
    }
    frame_told, rows_told = wrong[spoil]
    robot.frame.hear_kept_poses({"r3": {"kept_frame": frame_told, "kept_poses": rows_told}})
    assert robot.frame.kept_pose() == told
    robot.frame.hear_kept_poses({"r3": {"kept_frame": frame, "kept_poses": rows}})
    assert robot.frame.kept_pose() != told, "another pose of the right shape is taken"


def test_what_was_measured_at_other_times_is_forgotten() -> None:
    team = Team()
    team.run(4)
    robot, samples = team.robots["r1"], team.robots["r2"].samples
    assert samples is not None
    robot.frame.update_pairs(team.block, robot.samples, {"r2": {"kinematics": samples[::-1, KINEMATICS] + 1.0}})
    robot.frame.forget_misfits(team.block)
    assert robot.frame.misfits == ("r2",)
    assert robot.frame.neighbours_poses() == {}
    team.run(ENOUGH)
    robot.frame.forget_misfits(team.block)
    assert robot.frame.misfits == ()
    assert team.distance(robot.frame.neighbours_poses()["r2"].pose, team.true_pose("r1", "r2")) < CLOSE


def test_what_neighbours_knew_of_a_former_hold_does_not_count(team: Team) -> None:
    # Its neighbours tell r4 its pose, after r1 has started again.
    team.restart("r1")
    team.run(1)
    team.dissolve(others_than("r1"))
    team.assemble(10)
    # Then it takes hold elsewhere, and nobody can know where.
    team.take_hold("r4")
    team.robots["r4"].gossip.announce_holding(True, team.block)
    team.run(3)
    assert team.robots["r4"].frame.kept_pose() is None
    poses = team.assemble()
    expected = poses["r3"] @ team.true_pose("r3", "r4")
    assert team.distance(poses["r4"], expected) < CLOSE


def test_a_team_whose_poses_cannot_be_relied_upon_falls_back_to_those_of_the_one_before(team: Team) -> None:
    team.dissolve()
    exact = team.exact
    for robot in team.robots.values():
        robot.frame.fall_back()
    poses = team.assemble(10)
    assert team.robots["r1"].gossip.frame() == team.number
    for name in NAMES:
        assert team.distance(poses[name], exact[name]) == 0.0


@pytest.mark.parametrize("times", [1, 2])
def test_poses_that_cannot_be_relied_upon_are_found_again(team: Team, times: int) -> None:
    """Those of the first team; or if falling back was in vain."""
    if times == 2:
        team.dissolve()
    for robot in team.robots.values():
        for _ in range(times):
            robot.frame.fall_back()
    team.run(3)
    assert all(robot.frame.kept_pose() is None for robot in team.robots.values())
    poses = team.assemble()
    assert team.robots["r1"].gossip.frame() > 0
    for name in NAMES:
        assert team.distance(poses[name], poses["r1"] @ team.true_pose("r1", name)) < CLOSE


@pytest.mark.parametrize("names", [("r1",), ("r2",), ("r3", "r4"), NAMES])
def test_who_starts_over_takes_its_former_pose_if_it_is_still_there(team: Team, names: tuple[str, ...]) -> None:
    team.start_over(*names)
    assert all(team.robots[name].frame.kept_pose() is None for name in names)
    poses = team.assemble()
    for name in NAMES:
        assert team.distance(poses[name], team.exact[name]) < ROUNDING
        assert team.robots[name].gossip.own.refined


def test_who_starts_over_elsewhere_finds_its_new_pose(team: Team) -> None:
    team.take_hold("r4")  # and nobody was told
    team.start_over("r4")
    poses = team.assemble()
    assert ROUNDING < team.distance(poses["r4"], poses["r3"] @ team.true_pose("r3", "r4")) < CLOSE
    assert not team.robots["r4"].gossip.own.refined


def test_who_has_taken_hold_since_does_not_take_the_pose_from_before(team: Team) -> None:
    team.start_over("r4")
    team.robots["r4"].gossip.announce_holding(True, team.block)
    team.take_hold("r4")
    team.run(1)
    team.robots["r4"].frame.start_over(team.block)
    team.robots["r4"].gossip.announce_holding(True, team.block)
    poses = team.assemble()
    assert not team.robots["r4"].gossip.own.refined
    assert team.distance(poses["r4"], poses["r3"] @ team.true_pose("r3", "r4")) < CLOSE
