"""A robot's share of the team's work: exact sums, joint poses, and the load's inertia, all in the body frame.

Poses are fitted again and again, each time in these steps:

1. *tell*: at blocks that all agents know, each tells its score;
2. *fit*: when it has heard all, the reference robot computes the joint step, and tells all poses and the block from
   which they count. Anybody could, but not everybody need have the same samples, where messages were lost, and must not
   be of another opinion on the poses for that;
3. *switch*: from that block on samples that enter the sums are carried with the new poses, and bear their version;
4. *map*: when the first such block leaves the sums, the motions of all samples are mapped to the new poses, and each
   tells the moments of its own wrench;
5. *correct*: when all have been heard, the total wrenches are corrected for the new poses as well.

So what was accumulated always is, to first order, what the newest poses would have given for all samples so far. Every
step waits for what it needs, however long that takes; whoever misses the switch makes sums incomplete, not wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from agents.common_moments import CommonMoments
from agents.load_memory import LoadMemory
from agents.sums import Entered, TeamSums
from coheft.estimation.acceleration import (
    DERIVATIVE_SPAN,
    MotionFusion,
    carried_constants,
    derivative,
    derivative_kernel,
    robot_constants,
)
from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.measurement import KINEMATICS, WRENCH
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.registration import RegistrationMoments, score_and_information
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses, refit_map, register_team
from coheft.wire.config import AgentConfig
from coheft.wire.messages import LoadChangeNotice, PayloadEstimate
from consensus.flood import Flood, Floods
from consensus.graph import Neighbours, diameter
from consensus.schedule import choose_schedule

_SHORTEST_ROUND = 0.2
"""Shortest time between two fits of the poses [s]."""
_CHUNK = 0.1
"""Robots tell each other every so often which blocks they have [s]."""
_PATIENCE = 0.25
"""After so long without a complete sum, the load may have changed unnoticed; and when sums are complete again, a change
in the meantime takes so long to be noticed [s]."""
_MOVING = 4.0
"""While a fit moves a pose by more of its standard deviations, it is too far from the optimum for these to be true."""
_LEFT = 0.25
"""Share of a fit's last step that may be left to go, because the fit is not linear."""
_SCORE_SIZE, _POSE_SIZE = 6, 12
EARLY = 10.0
"""How far back from their start the sums reach [s]."""


@dataclass(frozen=True)
class Found:
    """What a robot knows of its team and the load.

    Attributes:
        poses: ``pose_j_in_i`` of the neighbours.
        payload: Mass properties in ``F_i``, None while there are none.
        unseen: What of them is not observable.
        learned_block: The newest block that is in it.
    """

    poses: Mapping[str, PoseEstimate]
    payload: PayloadEstimate | None
    unseen: tuple[str, ...]
    learned_block: int


class Team:
    """State of one agent since the sums of a team began.

    Args:
        config: The agent's settings.
        graph: The team's.
        poses: Of all its members, roughly, by name. That of the first defines the body frame.
        start: Block at which the sums begin, the same for everybody.
        history: Own samples of the blocks before, by number. They follow, one per block, through sums of their own.

    Attributes:
        learned_block: Newest block whose total was learned from, -1 while there is none.
        total_block: Block of the newest total, -1 while there is none.
        total_wrench: Total wrench (6,) about the origin of ``F_i`` at its last sample.
        load_changes: Noticed so far.
    """

    def __init__(
        self,
        config: AgentConfig,
        graph: Neighbours,
        poses: Mapping[str, Pose],
        start: int,
        history: Mapping[int, Array],
    ) -> None:
        self._config = config
        self._names = sorted(graph)
        self._own = self._names.index(config.name)
        self._neighbours = graph[config.name]
        self._poses = tuple(poses[name] for name in self._names)
        schedule = choose_schedule({name: graph[name] for name in self._names})
        self._sums, self._early_sums = (
            TeamSums(channel, config.name, self._neighbours, schedule, config.block, config.noise)
            for channel in ("sums", "early")
        )
        # Everybody goes back equally far; whoever does not have a block any more lets it be left out.
        self._delay = min(start, self._blocks(EARLY))
        self._start = start
        self._early_end = start + schedule.rounds + self._delay
        self._history = dict(history)
        self._next = start
        # Whoever is farthest has heard a diameter later; one block more, so that a lost message does no harm.
        self._hearing = diameter(graph) + 1

        half_span = max(2, min(config.block, round(DERIVATIVE_SPAN * config.rate)))
        self._kernel = derivative_kernel(half_span, 1.0 / config.rate)
        self._half_span = half_span
        self._fusion = self._fuse()
        self._totals: dict[int, tuple[Entered, Array]] = {}
        self._told_moments = RegistrationMoments.none()
        self._found_before: Found | None = None
        self._fitted: TeamPoses | None = None
        self._memory = LoadMemory(config, len(self._names), self._own)
        self._memory.set_poses(self._poses, self._fusion)

        # Versions of the poses: those that the past was mapped to, corrected for, and what is carried now.
        self._version = self._corrected = self._carried = 0
        self._carrying_pose = self._poses[self._own]
        self._told_poses: dict[int, tuple[Pose, ...]] = {}
        self._longest_round = 3 * self._hearing + schedule.rounds + 3
        self._tells, self._tell_step = 0, schedule.rounds + self._blocks(_SHORTEST_ROUND)
        members = len(self._names)
        self._common = CommonMoments(members, self._own, start, self._blocks(_CHUNK), parts=2)
        self._scores = Flood(members, 1 + _SCORE_SIZE)
        self._fits = Flood(1, 1 + members * _POSE_SIZE)
        self._crosses = Flood(members, LoadMemory.told_size)
        self._floods = Floods(
            {"common": self._common.flood, "scores": self._scores, "fits": self._fits, "crosses": self._crosses}
        )
        self._rounds = schedule.rounds
        self._patience = self._blocks(_PATIENCE)
        self._resumed_block = self._settled_block = -1
        self._noticed_block = -1
        self.learned_block = -1
        self.total_block = -1
        self.total_wrench = np.zeros(6)
        self.load_changes: list[LoadChangeNotice] = []

    def step(self, index: int, samples: Array | None, inbox: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
        """One block: it enters the sums, and one that entered earlier leaves them."""
        if index != self._next:
            self._sums.clear()
            self._early_sums.clear()
        self._next = index + 1
        for name, channels in inbox.items():
            self._floods.hear(name, channels)
            self._hear_of_change(channels.get("load_change"), index)
        self._fit_poses(index)
        finished = self._sums.advance(inbox)
        newest = None if finished is None else self._take_in(*finished, index)
        self._sums.enter(self._entered(index, samples))
        told = self._sums.channels()
        early = None
        if index < self._early_end:
            early = self._catch_up(index, inbox)
            told |= self._early_sums.channels()
        self._common.add(index, (newest, early))
        told["load_change"] = np.array([float(self._memory.changed_at)])
        return told | self._floods.channels()

    def poses(self) -> dict[str, Pose]:
        """Of all members, in the body frame."""
        return dict(zip(self._names, self._poses, strict=True))

    def found(self) -> Found | None:
        """What is known of poses and load; None as long as no poses have been fitted.

        While a fit is under way, motions are seen with new poses and wrenches with old ones: then, what was known before.
        """
        if self._corrected == self._version and self._fitted is not None:
            payload, unseen = self._memory.payload(self._own, self._fitted)
            return Found(self._neighbours_poses(self._fitted), payload, unseen, self.learned_block)
        if self._found_before is not None and self._memory.changed_at > self._found_before.learned_block:
            return replace(self._found_before, payload=None)
        return self._found_before

    def _neighbours_poses(self, fitted: TeamPoses) -> dict[str, PoseEstimate]:
        return {name: fitted.relative(self._own, self._names.index(name)) for name in sorted(self._neighbours)}

    def doubts(self) -> tuple[str, ...]:
        """Why what is known of the load may not be true any more."""
        if self.learned_block < 0:
            return ("the team's sums have just begun",)
        age = self._next - 1 - self._rounds - self.learned_block
        if age > self._patience:
            return (f"no complete sum of the team since {self._time(self.learned_block + 1):.2f} s",)
        if self._fitted is not None:
            deviations = np.sqrt(np.diag(self._fitted.covariance)[_SCORE_SIZE:])
            if np.any(np.abs(np.concatenate(self._steps[1:])) > _MOVING * deviations):
                return ("the poses are still being found",)
        if self.learned_block < self._settled_block:
            return (f"complete sums of the team again since {self._time(self._resumed_block):.2f} s only",)
        return ()

    # --- sums ---

    def _entered(self, block: int, samples: Array | None) -> Entered | None:
        return None if samples is None else Entered(block, samples, self._carrying_pose, self._carried)

    def _catch_up(self, index: int, inbox: Mapping[str, Mapping[str, Array]]) -> RegistrationMoments | None:
        """One block from before the start enters the sums, and another leaves them."""
        finished = self._early_sums.advance(inbox)
        block = index - self._delay
        self._early_sums.enter(self._entered(block, self._history.pop(block, None) if block < self._start else None))
        if finished is None or self._fusion.derivative_gain is not None or finished[0].version != self._version:
            return None
        entered, sums = finished
        motion = self._fusion.motion(sums)
        self._memory.push_early(motion, sums[:, 0], entered.samples[:, WRENCH])
        return RegistrationMoments.of(entered.samples[:, KINEMATICS], motion)

    def _take_in(self, entered: Entered, sums: Array, index: int) -> RegistrationMoments | None:
        """The team's sums of a block, in the body frame; returns what they say of the own pose."""
        block = entered.block
        self._totals[block] = entered, sums
        self._totals = {number: total for number, total in self._totals.items() if number > block - 3}
        self.total_block = block
        self.total_wrench = entered.pose.inverse().adjoint() @ sums[-1, 0]
        # Where the gyros have to fill in, their slope takes the neighbouring blocks.
        return self._learn(block if self._fusion.derivative_gain is None else block - 1, index)

    def _learn(self, block: int, index: int) -> RegistrationMoments | None:
        if block <= self.learned_block or block not in self._totals:
            return None  # new poses have made the derivative needless, or needed
        entered, sums = self._totals[block]
        if entered.version != self._version:
            self._map_to(entered.version)
        w_derivative = None
        if self._fusion.derivative_gain is not None:
            w_derivative = self._slope(block)
            if w_derivative is None:
                return None
        if block > self.learned_block + self._patience and self.learned_block >= 0:
            self._resumed_block, self._settled_block = block, block + self._patience
        self.learned_block = block
        motion = self._fusion.motion(sums, w_derivative)
        changed_at = self._memory.push(block, motion, sums[:, 0], entered.samples[:, WRENCH])
        if changed_at is not None:
            self._notice(changed_at, index)
        return RegistrationMoments.of(entered.samples[:, KINEMATICS], motion)

    def _slope(self, block: int) -> Array | None:
        """Derivative of the fused ``w`` during a block (B, 3), None if a block beside it is missing."""
        around = [self._totals.get(number) for number in (block - 1, block, block + 1)]
        w = [self._fusion.angular_velocity(total[1]) for total in around if total is not None]
        size, half = self._config.block, self._half_span
        return derivative(np.concatenate(w)[size - half : 2 * size + half], self._kernel) if len(w) == 3 else None

    # --- load changes ---

    def _hear_of_change(self, changed_at: Array | None, index: int) -> None:
        if changed_at is not None and changed_at.shape == (1,) and changed_at[0] <= index:
            if self._memory.adopt(int(changed_at[0])):
                self._notice(int(changed_at[0]), index)

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

    def _fit_poses(self, index: int) -> None:
        """Whatever step of the fit is due."""
        while self._common.agree(index - 1):
            self._tell_score()
        if self._own == 0:
            self._fit(index)
        self._switch(index)
        rows = self._crosses.rows(self._version)
        if self._corrected < self._version and rows is not None:
            assert self._fitted is not None  # as there is a version
            self._memory.correct(rows, self._fitted)
            self._corrected = self._version

    def _tell_score(self) -> None:
        """A chunk of steps has been agreed upon: if it is time, tell the own score at the present poses.

        When it is time depends on the number of agreed chunks only: everybody tells of the same samples.
        """
        steps = self._common.chunks * self._common.chunk_size
        if steps < self._tell_step:
            return
        self._tells += 1
        grown = round(self._config.efficient.refit_share * steps)
        self._tell_step = steps + max(self._longest_round, self._blocks(_SHORTEST_ROUND), grown)
        if self._corrected == self._version == self._carried:
            score, _, _ = score_and_information(self._common.total, self._poses[self._own], self._config.noise)
            self._scores.tell(self._own, self._tells, np.concatenate([[self._version], score]))
            self._told_moments = self._common.total

    def _fit(self, index: int) -> None:
        """As the reference robot: all poses after the joint step, once everybody's score at the present ones is known."""
        rows = self._scores.rows(self._tells)
        if self._tells <= self._carried or self._fits.row(0)[0] >= self._tells or rows is None:
            return
        if np.any(rows[:, 0] != self._version):
            return
        fitted = register_team(self._poses, rows[:, 1:], self._told_moments, self._config.noise)
        numbers = [pose.numbers() for pose in fitted.poses]
        self._fits.tell(0, self._tells, np.concatenate([[index + self._hearing], *numbers]))

    def _switch(self, index: int) -> None:
        """From the block that the reference robot has told on, carry samples with the poses that it has told."""
        version, row = self._fits.row(0)
        if version > self._carried and index >= row[0]:
            self._told_poses[version] = tuple(Pose.of_numbers(numbers) for numbers in row[1:].reshape(-1, _POSE_SIZE))
            self._carried = version
            self._carrying_pose = self._told_poses[version][self._own]

    def _map_to(self, version: int) -> None:
        """All samples so far count from now on as if they had been carried with the poses of a version."""
        self._found_before = self.found()
        poses = self._told_poses.pop(version)
        feature_map = refit_map(self._poses, poses, self._config.noise)
        self._common.map(feature_map)
        self._memory.map_features(feature_map, self._poses, poses)
        self._steps = [perturbation_between(old, new) for old, new in zip(self._poses, poses, strict=True)]
        self._poses, self._version = poses, version
        self._fusion = self._fuse()
        self._memory.set_poses(poses, self._fusion)
        # Poses are known by the samples that they were fitted to; more have come since.
        fitted_to = self._told_moments.mapped(feature_map)
        fitted = register_team(poses, np.zeros((len(poses), _SCORE_SIZE)), fitted_to, self._config.noise)
        left = _LEFT * np.concatenate(self._steps)
        self._fitted = replace(fitted, covariance=fitted.covariance + np.outer(left, left))
        self._crosses.tell(self._own, version, self._memory.told())

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
