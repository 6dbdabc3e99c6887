"""A robot's share of the team's work: exact sums, joint poses, and the load's inertia, all in the body frame.

Poses are fitted again and again, in five steps at blocks that all agents know:

1. *tell*: each tells its score, and a diameter later everybody has heard everybody;
2. *fit*: the reference robot computes the joint step, and tells all poses. Anybody could, but not everybody need have
   the same samples, where messages were lost, and must not be of another opinion on the poses for that;
3. *switch*: a diameter later, samples that enter the sums from now on are carried with the new poses;
4. *map*: the last block with old poses has left the sums. The motions of all samples are mapped to the new poses, and
   each tells the moments of its own wrench;
5. *correct*: a diameter later, the total wrenches are corrected for the new poses as well.

So what was accumulated always is, to first order, what the newest poses would have given for all samples so far.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agents.fit_rounds import FitRound, FitRounds
from agents.load_memory import LoadMemory
from coheft.estimation.acceleration import (
    CHANNELS,
    DERIVATIVE_SPAN,
    MotionFusion,
    carried_constants,
    derivative,
    derivative_kernel,
    robot_constants,
    summands,
)
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

_SHORTEST_ROUND = 0.2
"""Shortest time between two fits of the poses [s]."""
_SCORE_SIZE, _POSE_SIZE = 6, 12
EARLY = 10.0
"""How far back from their start the sums reach [s]."""


@dataclass(frozen=True, eq=False)
class _Entered:
    """A block of own samples (B, 15) on its way through the sums, and the own pose that it was carried with."""

    samples: Array
    pose: Pose


class Team:
    """State of one agent since the network's sums began.

    Args:
        config: The agent's settings.
        gossip: Knows the graph, and the poses that everybody starts with.
        start: Block at which the sums begin, the same for everybody.
        history: Own samples of the blocks before, by number. They follow, one per block, through sums of their own.

    Attributes:
        total_block: Block of the newest total, -1 while there is none.
        total_wrench: Total wrench (6,) about the origin of ``F_i`` at its last sample.
        load_changes: Noticed so far.
    """

    def __init__(self, config: AgentConfig, gossip: Gossip, start: int, history: Mapping[int, Array]) -> None:
        graph = gossip.graph
        poses = tuple(gossip.pose(name) for name in sorted(graph or ()))
        # Without the graph, and without a pose, nobody would have been ready.
        assert graph is not None
        self._poses = tuple(pose for pose in poses if pose is not None)
        assert len(self._poses) == len(graph)
        self._config = config
        self._names = sorted(graph)
        self._own = self._names.index(config.name)
        schedule = choose_schedule({name: graph[name] for name in self._names})
        self._scale = schedule.scale
        self._own_gains = schedule.gains(config.name, config.name)
        self._gains = {name: schedule.gains(config.name, name) for name in graph[config.name]}
        self._pipeline = Pipeline(schedule.rounds, config.block, CHANNELS)
        self._early_pipeline = Pipeline(schedule.rounds, config.block, CHANNELS)
        # Everybody goes back equally far; whoever does not have a block any more lets it be left out.
        self._delay = min(start, self._blocks(EARLY))
        self._start = start
        self._history = dict(history)
        # Whoever is farthest has heard a diameter later; one block more, so that a lost message does no harm.
        self._hearing = diameter(graph) + 1

        self._half_span = max(2, min(config.block, round(DERIVATIVE_SPAN * config.rate)))
        self._kernel = derivative_kernel(self._half_span, 1.0 / config.rate)
        self._carrying_pose = self._poses[self._own]
        self._fusion = self._fuse()
        self._moments = RegistrationMoments.none()
        self._scored_moments = self._moments
        self._fitted: TeamPoses | None = None
        self._memory = LoadMemory(config, len(self._names), self._own)
        self._memory.set_poses(self._poses, self._fusion)

        self._entered: dict[int, _Entered] = {}
        self._sums: dict[int, Array] = {}
        self._learned_block = -1
        self._rounds = FitRounds(
            start, schedule.rounds, self._hearing, self._blocks(_SHORTEST_ROUND), config.efficient.refit_share
        )
        self._scores = Flood(len(self._names), _SCORE_SIZE + _POSE_SIZE)
        self._fits = Flood(1, len(self._names) * _POSE_SIZE)
        self._crosses = Flood(len(self._names), LoadMemory.told_size)
        self._new: TeamPoses | None = None
        self._noticed_block = -1
        self.total_block = -1
        self.total_wrench = np.zeros(6)
        self.load_changes: list[LoadChangeNotice] = []

    def step(self, index: int, samples: Array | None, inbox: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
        """One block: it enters the sums, and one that entered earlier leaves them."""
        for channels in inbox.values():
            self._hear(channels, index)
        finished = self._pipeline.advance(self._stages(inbox, "sums"), self._own_gains)
        leaving = index - self._pipeline.rounds
        fit_round = self._rounds.at(index)
        self._fit_poses(fit_round, index)
        if finished is not None:
            self._take_in(leaving, index, self._scale * finished)
        self._enter(self._pipeline, index, samples)
        self._entered.pop(leaving - 3, None)
        self._sums.pop(leaving - 3, None)
        early = self._catch_up(index, inbox)
        told = early | {
            "sums": self._pipeline.stages.copy(),
            "sums_valid": self._pipeline.valid.astype(np.float64),
            "load_change": np.array([float(self._memory.changed_at)]),
        }
        if fit_round.tell <= index < fit_round.fit:
            told["scores"] = self._scores.table
        if fit_round.fit <= index < fit_round.switch:
            told["fits"] = self._fits.table
        if fit_round.map <= index < fit_round.correct:
            told["crosses"] = self._crosses.table
        return told

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

    def _stages(self, inbox: Mapping[str, Mapping[str, Array]], channel: str) -> list[NeighbourStages]:
        stages = []
        for name, gains in self._gains.items():
            channels = inbox.get(name, {})
            valid = channels.get(f"{channel}_valid")
            stages.append(NeighbourStages(None, gains, channels.get(channel), None if valid is None else valid > 0.5))
        return stages

    def _enter(self, pipeline: Pipeline, block: int, samples: Array | None) -> None:
        if samples is None:
            pipeline.enter(None)
            return
        self._entered[block] = _Entered(samples, self._carrying_pose)
        own = summands(samples, self._config.noise) @ self._carrying_pose.adjoint().T
        pipeline.enter(own.reshape(len(samples), CHANNELS))

    def _catch_up(self, index: int, inbox: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
        """One block from before the start enters the sums, and another leaves them; what to tell of that."""
        pipeline = self._early_pipeline
        entering = index - self._delay
        if entering >= self._start + pipeline.rounds:
            return {}
        finished = pipeline.advance(self._stages(inbox, "early"), self._own_gains)
        entered = self._entered.pop(entering - pipeline.rounds, None)
        if finished is not None and entered is not None and self._fusion.derivative_gain is None:
            sums = (self._scale * finished).reshape(-1, 3, 6)
            motion = self._fusion.motion(sums)
            self._moments += RegistrationMoments.of(entered.samples[:, KINEMATICS], motion)
            self._memory.push_early(motion, sums[:, 0], entered.samples[:, WRENCH])
        self._enter(pipeline, entering, self._history.pop(entering, None) if entering < self._start else None)
        return {"early": pipeline.stages.copy(), "early_valid": pipeline.valid.astype(np.float64)}

    def _take_in(self, block: int, index: int, totals: Array) -> None:
        """The network's totals of a block, in the body frame."""
        self._sums[block] = totals.reshape(-1, 3, 6)
        self.total_block = block
        self.total_wrench = self._entered[block].pose.inverse().adjoint() @ totals[-1, :6]
        if self._fusion.derivative_gain is None:
            self._learn(block, index, None)
            return
        # The gyros have to fill in, and their slope takes the neighbouring blocks.
        around = [self._sums[number] for number in (block - 2, block - 1, block) if number in self._sums]
        if len(around) == 3:
            w = np.concatenate([self._fusion.angular_velocity(sums) for sums in around])
            size, half = self._config.block, self._half_span
            self._learn(block - 1, index, derivative(w[size - half : 2 * size + half], self._kernel))

    def _learn(self, block: int, index: int, w_derivative: Array | None) -> None:
        if block <= self._learned_block:
            return  # new poses have made the derivative needless, or needed
        self._learned_block = block
        samples, sums = self._entered[block].samples, self._sums[block]
        motion = self._fusion.motion(sums, w_derivative)
        self._moments += RegistrationMoments.of(samples[:, KINEMATICS], motion)
        changed_at = self._memory.push(block, motion, sums[:, 0], samples[:, WRENCH])
        if changed_at is not None:
            self._notice(changed_at, index)

    def _notice(self, changed_at: int, index: int) -> None:
        """The load has changed, as this robot or another one has found."""
        notice = LoadChangeNotice(self._time(index + 1), self._time(changed_at))
        if self.load_changes and index - self._noticed_block <= self._hearing:
            # Somebody found the same change at the same time, and places it a bit later.
            notice = LoadChangeNotice(self.load_changes.pop().noticed_at, notice.changed_at)
        else:
            self._noticed_block = index
        self.load_changes.append(notice)

    # --- poses ---

    def _hear(self, channels: Mapping[str, Array], index: int) -> None:
        if "scores" in channels:
            self._scores.hear(channels["scores"])
        if "fits" in channels:
            self._fits.hear(channels["fits"])
        if "crosses" in channels:
            self._crosses.hear(channels["crosses"])
        if "load_change" in channels:
            changed_at = int(channels["load_change"][0])
            if self._memory.adopt(changed_at):
                self._notice(changed_at, index)

    def _fit_poses(self, fit_round: FitRound, index: int) -> None:
        """Which step of the fit this block is for, if any."""
        if index == fit_round.tell:
            own = self._poses[self._own]
            score, _, _ = score_and_information(self._moments, own, self._config.noise)
            self._scored_moments = self._moments  # what the step is worked out from, and known by
            mean_score = score / max(self._moments.count, 1.0)
            self._scores.tell(self._own, fit_round.number, np.concatenate([mean_score, own.numbers()]))
        elif index == fit_round.fit and self._own == 0:
            rows = self._scores.rows(fit_round.number)
            if rows is not None:
                self._fits.tell(0, fit_round.number, self._fit(rows))
        elif index == fit_round.switch:
            self._new = self._switch(self._fits.rows(fit_round.number))
        elif index == fit_round.map + self._lag and self._new is not None:
            self._map_to(self._new.poses)
            self._new = None
            self._crosses.tell(self._own, fit_round.number, self._memory.told())
        elif index == fit_round.correct and self._fitted is not None:
            self._memory.correct(self._crosses.rows(fit_round.number), self._fitted)

    def _fit(self, rows: Array) -> Array:
        """All poses (12 N,) after the joint step, from everybody's mean score and pose (N, 18)."""
        # What each says of its own pose counts, should somebody have missed an earlier fit.
        poses = tuple(Pose.of_numbers(numbers) for numbers in rows[:, _SCORE_SIZE:])
        # Means, because not everybody need have missed the same samples.
        scores = self._scored_moments.count * rows[:, :_SCORE_SIZE]
        fitted = register_team(poses, scores, self._scored_moments, self._config.noise)
        return np.concatenate([pose.numbers() for pose in fitted.poses])

    def _switch(self, rows: Array | None) -> TeamPoses | None:
        """From now on use the poses (1, 12 N) that the reference robot has told; None if that has not been heard."""
        if rows is None:
            return None
        poses = tuple(Pose.of_numbers(numbers) for numbers in rows.reshape(-1, _POSE_SIZE))
        no_step = np.zeros((len(poses), _SCORE_SIZE))
        self._fitted = register_team(poses, no_step, self._scored_moments, self._config.noise)
        self._carrying_pose = self._fitted.poses[self._own]
        return self._fitted

    @property
    def _lag(self) -> int:
        """Blocks that a total has to wait before it can be learned from."""
        return 0 if self._fusion.derivative_gain is None else 1

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
