"""Four robots in a line that find their poses in the team's body frame, without agents around them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np

from agents.body_frame import BodyFrame
from agents.known_pose import KnownPose
from coheft.estimation.body_motion import grasp_measurements, perturbation_between
from coheft.estimation.measurement import KINEMATICS, SAMPLE_SIZE
from coheft.estimation.spatial import Array, Pose
from coheft.wire.config import agent_config
from coheft.wire.messages import LinkState
from consensus.gossip import Gossip
from tests.estimation.team import body_motion, random_pose
from tests.in_process import changed

SCENARIO = changed("line4")
NAMES = SCENARIO.robot_names
GRAPH = {"r1": ("r2",), "r2": ("r1", "r3"), "r3": ("r2", "r4"), "r4": ("r3",)}
SIZE, RATE = SCENARIO.sensors.block, SCENARIO.sensors.rate
ENOUGH = 150
"""Blocks that show everybody's pose."""
DEVIATIONS = {"r1": np.zeros(6), "r2": np.arange(1.0, 7.0) * 1e-3, "r3": np.full(6, 2e-3)}
"""How well teams know their poses; nobody knows how well that of r4."""


@cache
def motion() -> Array:
    """Of the body, exact, shape (400 B, 12)."""
    return body_motion(np.random.default_rng(4), np.arange(400 * SIZE) / RATE)


class Robot:
    """One robot before the sums begin."""

    def __init__(self, name: str, incarnation: int = 0) -> None:
        self.gossip = Gossip(name, GRAPH[name], incarnation)
        self.frame = BodyFrame(agent_config(SCENARIO, name, GRAPH[name]), self.gossip)
        self.samples: Array | None = None
        self.said: dict[str, Array] = {}
        self.records: list[LinkState] = []

    def pose(self) -> Pose | None:
        return self.gossip.pose(self.gossip.name)


class Team:
    """Four robots in a line that move a body together, and talk with each other.

    Attributes:
        grasps: Where they hold it; None: an arm that waits.
        block: The next one.
    """

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        self.grasps: dict[str, Pose | None] = {name: random_pose(rng) for name in NAMES}
        self._motion = motion()
        self._rng = rng
        self.block = 0
        self.robots = {name: Robot(name) for name in NAMES}

    def run(self, blocks: int, cut_off: str = "") -> None:
        """Everybody talks with everybody but for one robot, and announces its pose when it knows it."""
        for _ in range(blocks):
            self._advance(cut_off)

    def _advance(self, cut_off: str) -> None:
        for name, robot in self.robots.items():
            heard = [] if name == cut_off else [other for other in GRAPH[name] if other != cut_off]
            for other in heard:
                robot.gossip.hear(self.robots[other].records)
            inbox = {other: self.robots[other].said for other in heard if self.robots[other].said}
            robot.frame.update_pairs(self.block - 1, robot.samples, inbox)
            robot.frame.hear_kept_poses(inbox)
            if robot.gossip.graph is not None and not robot.gossip.is_ready:
                kept = robot.frame.kept_pose()
                found = robot.frame.found_pose() if kept is None and self.block % 10 == 0 else None
                if kept is not None:
                    known, frame = kept
                    robot.gossip.announce_ready(self.block, known.pose, frame, True, known.deviations)
                elif found is not None:
                    robot.gossip.announce_ready(self.block, *found)
        for name, robot in self.robots.items():
            robot.samples = self._measured(name)
            robot.said = robot.frame.channels() | {"kinematics": robot.samples[:, KINEMATICS]}
            robot.records = robot.gossip.news()
        self.block += 1

    def _measured(self, name: str) -> Array:
        samples = np.zeros((SIZE, SAMPLE_SIZE))
        motion = self._motion[self.block * SIZE : (self.block + 1) * SIZE]
        grasp = self.grasps[name]
        if grasp is not None:
            samples[:, KINEMATICS] = grasp_measurements(grasp, motion)
        result: Array = samples + SCENARIO.noise.per_column() * self._rng.normal(size=samples.shape)
        return result

    def assemble(self, blocks: int = ENOUGH) -> dict[str, Pose]:
        """Go on until everybody knows its pose, all in the same frame; returns the poses of those who hold the load."""
        self.run(blocks)
        one, *others = self.robots.values()
        members = one.gossip.graph
        assert members is not None
        poses = {name: one.gossip.pose(name) for name in members}
        known = {name: pose for name, pose in poses.items() if pose is not None}
        assert known.keys() == members.keys()
        assert len({one.gossip.records[name].frame for name in members} | {one.gossip.frame()}) == 1
        assert one.gossip.frame() > 0
        for robot in others:
            assert robot.gossip.records == one.gossip.records
        return known

    def begin_sums(self, poses: dict[str, Pose]) -> None:
        """The team's sums begin, and fits make the poses better: here, exact."""
        self.holds = {name: self.robots[name].gossip.own.since for name in poses}
        self.exact = {name: poses[min(poses)] @ self.true_pose(min(poses), name) for name in poses}
        self.number = self.robots["r1"].gossip.frame()

    def dissolve(self, names: Iterable[str] = NAMES) -> None:
        """The team is another one: these robots keep what they know."""
        for name in names:
            known = {other: KnownPose(pose, DEVIATIONS.get(other)) for other, pose in self.exact.items()}
            self.robots[name].frame.keep(self.number, known, self.holds)

    def restart(self, name: str) -> None:
        self.robots[name] = Robot(name, self.robots[name].gossip.own.incarnation + 1)

    def start_over(self, *names: str) -> None:
        """As if these robots had taken hold again, though they have not."""
        for name in names:
            self.robots[name].frame.start_over(self.block)
            self.robots[name].gossip.announce_holding(True, self.block)
            self.dissolve([name])
        self.run(3)
        self.dissolve(others_than(*names))

    def take_hold(self, name: str) -> None:
        """Elsewhere than ever before."""
        self.grasps[name] = random_pose(np.random.default_rng(self.block))

    def true_pose(self, i: str, j: str) -> Pose:
        """``pose_j_in_i``."""
        grasp_i, grasp_j = self.grasps[i], self.grasps[j]
        assert grasp_i is not None
        assert grasp_j is not None
        return grasp_i.inverse() @ grasp_j

    def distance(self, a: Pose, b: Pose) -> float:
        return float(np.abs(perturbation_between(a, b)).max())


def others_than(*names: str) -> list[str]:
    return [name for name in NAMES if name not in names]
