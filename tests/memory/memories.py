"""What all robots of a team remember of its load, for tests."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from agents.load_memory import LoadMemory
from agents.load_moments import block_moments
from coheft.estimation.body_motion import perturbed
from coheft.estimation.inertia import GRAM_SIZE
from coheft.estimation.measurement import WRENCH
from coheft.estimation.motion_fusion import MotionFusion, derivative_kernel
from coheft.estimation.observability import Visibility
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses, refit_map
from coheft.wire.config import AgentConfig, agent_config
from tests.estimation.team import Team, make_team
from tests.estimation.test_team_registration import fused_motion
from tests.in_process import changed

BLOCK = 10
COUNT = 4
OWN = 2
DURATION = 6.0


def held_team() -> Team:
    """The team whose exact samples are remembered."""
    return make_team(7, count=COUNT, duration=DURATION)


def own_config() -> AgentConfig:
    """Settings of the robot ``OWN``."""
    scenario = changed("ring6")
    sensors = msgspec.structs.replace(scenario.sensors, rate=100, block=BLOCK)
    return agent_config(msgspec.structs.replace(scenario, sensors=sensors), "r3", ("r2", "r4"))


class Memories:
    """What all robots remember of the exact samples of a team, summed with some poses."""

    def __init__(self, config: AgentConfig, team: Team, poses: Sequence[Pose]) -> None:
        self.team = team
        self.poses = poses
        self.each = [LoadMemory(config, own, poses, self._fusion(poses)) for own in range(COUNT)]

    def _fusion(self, poses: Sequence[Pose]) -> MotionFusion:
        return MotionFusion.of_robots(self.team.noise, poses, derivative_kernel(2, 0.01))

    def push(self, first: int, last: int, load: float = 1.0, robots: Sequence[int] = range(COUNT)) -> list[int | None]:
        """Blocks ``first`` to ``last - 1``, of a load so many times as heavy. Returns what the first robot found."""
        found = []
        for block in range(first, last):
            sums = self.sums(block, load)
            changes = [self.each[robot].push(block, sums[robot]) for robot in robots]
            found.append(changes[0])
        return found

    def sums(self, block: int, load: float) -> list[Array]:
        """What is summed of a block, for each robot."""
        samples = self.team.exact[BLOCK * block : BLOCK * (block + 1)] * np.repeat([1.0, load], [9, 6])
        motion = fused_motion(samples, self.poses, self.team.noise)
        wrench = np.sum([samples[:, i, WRENCH] @ pose.adjoint().T for i, pose in enumerate(self.poses)], axis=0)
        return [block_moments(samples[:, i], motion, wrench)[1] for i in range(COUNT)]

    def push_early(self, first: int, last: int, load: float = 1.0, robots: Sequence[int] = range(COUNT)) -> None:
        """Blocks ``last - 1`` back to ``first``, from before all others."""
        for block in range(last - 1, first - 1, -1):
            sums = self.sums(block, load)
            for robot in robots:
                self.each[robot].push_early(block, sums[robot])

    def begin_again(self, poses: Sequence[Pose]) -> None:
        """New poses come into use, and with them all samples again."""
        self.map_to(poses)
        for memory in self.each:
            memory.begin_again(self.team_poses())

    def map_to(self, poses: Sequence[Pose]) -> None:
        feature_map = refit_map(self.poses, poses, self.team.noise)
        for memory in self.each:
            memory.use_poses(feature_map, self.poses, poses, self._fusion(poses))
        self.poses = poses

    def begin_roughly(self) -> None:
        """Some blocks, then these are to come again, seen with better poses."""
        self.push(0, 20)
        self.begin_again(moved(self.team, 4e-3))
        self.correct(self.told())

    def told(self) -> Array:
        return np.array([memory.told() for memory in self.each])

    def told_of_another_load(self) -> Array:
        rows = self.told()
        rows[-1, 0] += 1.0
        return rows

    def correct(self, rows: Array, variance: float = 1e-12) -> None:
        """With poses that are as uncertain as said."""
        for memory in self.each:
            memory.correct(rows, self.team_poses(variance))

    def fit(self, poses: Sequence[Pose]) -> None:
        """All of a fit at once."""
        self.map_to(poses)
        self.correct(self.told())

    def team_poses(self, variance: float = 1e-12) -> TeamPoses:
        """Known well, if nothing else is said."""
        return TeamPoses(tuple(self.poses), variance * np.eye(6 * COUNT), Visibility())

    def grams(self) -> Array:
        """Packed Gram matrices (N, 190) of all samples that count, of every robot."""
        return np.array([memory._window.total[:GRAM_SIZE] for memory in self.each])

    def deviations(self) -> Array:
        """Standard deviations of what one robot believes."""
        payload, _ = self.each[OWN].payload(OWN, self.team_poses())
        assert payload is not None
        result: Array = np.sqrt(np.diag(payload.covariance))
        return result

    def estimate(self) -> Array:
        """``(m, m h, I_o)`` as one robot believes it."""
        payload, unseen = self.each[OWN].payload(OWN, self.team_poses())
        assert payload is not None
        assert payload.com is not None
        assert payload.tensor is not None
        assert unseen == ()
        return Inertia(payload.mass, payload.com, payload.tensor).barycentric()


def with_a_fit_under_way(config: AgentConfig, team: Team) -> Memories:
    """40 blocks and a fit after 10 of them; now all samples are seen with the true poses, but not corrected yet."""
    memories = Memories(config, team, moved(team, 4e-3))
    memories.push(0, 10)
    memories.fit(moved(team, 2e-3))
    memories.push(10, 40)
    memories.map_to(team.poses)
    return memories


def moved(team: Team, size: float) -> list[Pose]:
    """The true poses, all but the reference's off by about ``size`` [rad, m]."""
    rng = np.random.default_rng(5)
    return [team.poses[0], *(perturbed(pose, size * rng.normal(size=6)) for pose in team.poses[1:])]


def distance(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b))
