"""A robot's share of the team's work: exact sums, joint poses, and the load's inertia, all in the body frame.

Poses are fitted again and again, in four steps at blocks that all agents know:

1. *tell*: each tells its score, and a diameter later everybody has heard everybody;
2. *fit*: all compute the same joint step. Samples that enter the sums from now on are carried with the new poses;
3. *map*: the last block with old poses has left the sums. The motions of all samples are mapped to the new poses, and
   each tells the moments of its own wrench;
4. *correct*: a diameter later, the total wrenches are corrected for the new poses as well.

So what was accumulated always is, to first order, what the newest poses would have given for all samples so far.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from agents.load_memory import LoadMemory
from coheft.estimation.acceleration import MotionFusion, carried_constants, derivative_kernel, robot_constants, summands
from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.measurement import KINEMATICS, WRENCH
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.registration import RegistrationMoments, score_and_information
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses, refit_map, register_team
from coheft.wire.config import AgentConfig
from coheft.wire.messages import LoadChangeNotice, PayloadEstimate
from consensus.flood import Flood
from consensus.gossip import Gossip
from consensus.graph import diameter
from consensus.pipeline import NeighbourStages, Pipeline
from consensus.schedule import choose_schedule

_CHANNELS = 18
_SHORTEST_ROUND = 0.2
"""Shortest time between two fits of the poses [s]."""
_KNOWN_ROTATION, _KNOWN_TRANSLATION = 1e-3, 1e-3
"""While poses are less certain, what looks like another load is not reported as one [rad, m]."""
_DERIVATIVE_SPAN = 0.02
"""Half the time over which a gyro is differentiated, where accelerometers do not see all of alpha [s]."""


class Team:
    """State of one agent since the network's sums began.

    Attributes:
        total_block: Block of the newest total, -1 while there is none.
        total_wrench: Total wrench (6,) about the origin of ``F_i`` at its last sample.
        load_changes: Noticed so far.
    """

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        graph = gossip.graph
        assert graph is not None  # without it nobody would have been ready
        self._config = config
        self._names = sorted(graph)
        self._own = self._names.index(config.name)
        schedule = choose_schedule({name: graph[name] for name in self._names})
        self._scale = schedule.scale
        self._own_gains = schedule.gains(config.name, config.name)
        self._gains = {name: schedule.gains(config.name, name) for name in graph[config.name]}
        self._pipeline = Pipeline(schedule.rounds, config.block, _CHANNELS)
        self._diameter = diameter(graph)

        self._half_span = max(2, min(config.block, round(_DERIVATIVE_SPAN * config.rate)))
        self._kernel = derivative_kernel(self._half_span, 1.0 / config.rate)
        self._poses = tuple(_pose(gossip.records[name].pose) for name in self._names)
        self._entering_poses = self._poses
        self._fusion = self._fuse()
        self._moments = RegistrationMoments.none()
        self._fitted: TeamPoses | None = None
        self._memory = LoadMemory(config, len(self._names), self._own)
        self._memory.set_poses(self._poses, self._fusion)

        self._samples: dict[int, Array] = {}
        self._sums: dict[int, Array] = {}
        self._scores = Flood(len(self._names), 6)
        self._crosses = Flood(len(self._names), self._memory.cross_size)
        self._fits = 0
        self._moved = 0.0
        self._first_block: int | None = None
        self._tell_block = self._fit_block = self._map_block = self._correct_block = -1
        self.total_block = -1
        self.total_wrench = np.zeros(6)
        self.load_changes: list[LoadChangeNotice] = []

    def step(self, index: int, samples: Array | None, inbox: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
        """One block: it enters the sums, and one that entered earlier leaves them."""
        if self._first_block is None:
            self._first_block = index
            self._tell_block = index + self._pipeline.rounds + self._blocks(_SHORTEST_ROUND)
        for channels in inbox.values():
            self._hear(channels)
        finished = self._pipeline.advance(self._stages(inbox), self._own_gains)
        self._fit_poses(index)
        leaving = index - self._pipeline.rounds
        if finished is not None and leaving >= self._first_block:
            self._take_in(leaving, index, self._scale * finished)
        self._enter(index, samples)
        self._samples.pop(leaving - 3, None)
        self._sums.pop(leaving - 3, None)
        return {
            "sums": self._pipeline.stages.copy(),
            "sums_valid": self._pipeline.valid.astype(np.float64),
            "scores": self._scores.table,
            "crosses": self._crosses.table,
            "load_change": np.array([float(self._memory.first_block)]),
        }

    def neighbours_poses(self) -> dict[str, PoseEstimate]:
        """``pose_j_in_i`` of the neighbours, once poses have been fitted."""
        if self._fitted is None:
            return {}
        return {name: self._fitted.relative(self._own, self._names.index(name)) for name in sorted(self._gains)}

    def payload(self) -> tuple[PayloadEstimate | None, tuple[str, ...]]:
        """Mass properties in ``F_i``, None while there are none, and what is not observable."""
        if self._fitted is None:
            return None, ()
        return self._memory.payload(self._own, self._fitted)

    # --- sums ---

    def _stages(self, inbox: Mapping[str, Mapping[str, Array]]) -> list[NeighbourStages]:
        stages = []
        for name, gains in self._gains.items():
            channels = inbox.get(name, {})
            valid = channels.get("sums_valid")
            stages.append(NeighbourStages(None, gains, channels.get("sums"), None if valid is None else valid > 0.5))
        return stages

    def _enter(self, index: int, samples: Array | None) -> None:
        if samples is None:
            self._pipeline.enter(None)
            return
        self._samples[index] = samples
        own = summands(samples, self._config.noise) @ self._entering_poses[self._own].adjoint().T
        self._pipeline.enter(own.reshape(len(samples), _CHANNELS))

    def _take_in(self, block: int, index: int, totals: Array) -> None:
        """The network's totals of a block, in the body frame."""
        self._sums[block] = totals.reshape(-1, 3, 6)
        wrench = totals[-1, :6] @ self._poses[self._own].inverse().adjoint().T
        self.total_block, self.total_wrench = block, wrench
        if self._fusion.derivative_gain is None:
            self._learn(block, index, None)
            return
        # The gyros have to fill in, and their slope takes the neighbouring blocks.
        around = [self._sums.get(number) for number in (block - 2, block - 1, block)]
        if any(sums is None for sums in around):
            return
        w = np.concatenate([self._fusion.angular_velocity(sums) for sums in around if sums is not None])
        size, half = self._config.block, self._half_span
        slope_of = w[size - half : 2 * size + half]
        windows = np.lib.stride_tricks.sliding_window_view(slope_of, len(self._kernel), axis=0)
        self._learn(block - 1, index, windows @ self._kernel)

    def _learn(self, block: int, index: int, w_derivative: Array | None) -> None:
        samples = self._samples.get(block)
        if samples is None:
            return
        sums = self._sums[block]
        motion = self._fusion.motion(sums, w_derivative)
        self._moments += RegistrationMoments.of(samples[:, KINEMATICS], motion)
        changed = self._memory.push(block, motion, sums[:, 0], samples[:, WRENCH])
        if changed is not None and self._are_poses_known():
            self.load_changes.append(LoadChangeNotice(self._time(index + 1), self._time(changed)))

    def _are_poses_known(self) -> bool:
        """Whether a change of the load can be told from one of the poses."""
        if self._fitted is None:
            return False
        deviations = np.sqrt(np.diag(self._fitted.covariance)).reshape(-1, 2, 3).max(axis=(0, 2))
        return bool(deviations[0] < _KNOWN_ROTATION and deviations[1] < _KNOWN_TRANSLATION)

    # --- poses ---

    def _hear(self, channels: Mapping[str, Array]) -> None:
        if "scores" in channels:
            self._scores.hear(channels["scores"])
        if "crosses" in channels:
            self._crosses.hear(channels["crosses"])
        if "load_change" in channels:
            self._memory.adopt(int(channels["load_change"][0]))

    def _fit_poses(self, index: int) -> None:
        """Which step of the fit this block is for, if any."""
        hops = self._diameter + 1
        if index == self._map_block:
            self._map_to(self._entering_poses)
            self._crosses.tell(self._own, self._fits, self._memory.told_cross())
            self._correct_block = index + hops
        if index == self._correct_block:
            crosses = self._crosses.rows(self._fits)
            if crosses is not None:
                self._memory.correct(crosses, self._moved)
        if index == self._tell_block:
            score, _, _ = score_and_information(self._moments, self._poses[self._own], self._config.noise)
            self._scores.tell(self._own, self._fits, score)
            self._fit_block = index + hops
        if index == self._fit_block:
            scores = self._scores.rows(self._fits)
            if scores is not None:
                self._fitted = register_team(self._poses, scores, self._moments, self._config.noise)
                self._moved = _distance(self._poses, self._fitted)
                self._memory.set_tolerance(self._fitted)
                self._entering_poses = self._fitted.poses
            self._fits += 1
            self._map_block = index + self._pipeline.rounds
            assert self._first_block is not None
            grown = round(self._config.efficient.refit_share * (index - self._first_block))
            self._tell_block = index + max(self._pipeline.rounds + hops + 1, grown, self._blocks(_SHORTEST_ROUND))

    def _map_to(self, poses: tuple[Pose, ...]) -> None:
        """All samples so far are in: from now on they count as if they had been carried with the new poses."""
        feature_map = refit_map(self._poses, poses, self._config.noise)
        self._moments = self._moments.mapped(feature_map)
        self._memory.map_features(feature_map, self._poses, poses)
        self._poses = poses
        self._fusion = self._fuse()
        self._memory.set_poses(poses, self._fusion)

    def _fuse(self) -> MotionFusion:
        constants = robot_constants(self._config.noise)
        return MotionFusion.of(
            np.sum([carried_constants(constants, pose) for pose in self._poses], axis=0), self._kernel
        )

    def _blocks(self, duration: float) -> int:
        return max(1, round(duration * self._config.rate / self._config.block))

    def _time(self, block: int) -> float:
        """Start of a block [s]."""
        return block * self._config.block / self._config.rate


def _distance(old: Sequence[Pose], fitted: TeamPoses) -> float:
    """Root mean square of all poses' steps, but the reference's, in units of their standard deviations."""
    steps = np.concatenate([perturbation_between(a, b) for a, b in zip(old, fitted.poses, strict=True)])
    deviations = np.sqrt(np.diag(fitted.covariance))
    return float(np.sqrt(np.mean(np.square(steps[6:] / deviations[6:]))))


def _pose(numbers: tuple[float, ...]) -> Pose:
    return Pose(np.reshape(numbers[:9], (3, 3)), np.array(numbers[9:]))
