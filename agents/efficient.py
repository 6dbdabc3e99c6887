"""The method at the Cramér-Rao bound, for one robot.

First, poses of the neighbours by maximum likelihood, and from neighbour to neighbour the robot's own pose in the frame
of the reference robot, the **body frame**. When everybody's is roughly known, the network's sums begin (``Team``):
everybody carries its own samples to the body frame with its own pose, so all rounds happen in one frame, and every
loop is closed by construction. The totals say how the body moves and what wrench moves it. Out of these come better
poses, again and again, with all samples since the start, and the load's inertia (``agents.load_memory.LoadMemory``).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from agents.estimator import Belief, Channels, is_converged
from agents.team import EARLY, Team
from coheft.estimation.measurement import KINEMATICS, MeasurementBlock
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.twist_registration import TwistMoments, register_twists
from coheft.estimation.uncertain_pose import UncertainPose
from coheft.wire.config import AgentConfig
from consensus.gossip import Gossip
from consensus.graph import distances

_DIRECTIONS = 6
_PAIRS_EVERY = 0.1
"""Time between two looks at the neighbours' poses, before the sums begin [s]."""


class EfficientEstimator:
    """One robot's share of the efficient method. See ``agents.estimator.Estimator``."""

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        self._config = config
        self._gossip = gossip
        self._pairs = {name: TwistMoments.none() for name in config.neighbours}
        self._history_length = max(2, round(EARLY * config.rate / config.block))
        self._look_every = max(1, round(_PAIRS_EVERY * config.rate / config.block))
        self._history: dict[int, Array] = {}
        self._team: Team | None = None

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """See ``Estimator.step``."""
        samples = None if own is None else own.samples
        start = self._gossip.start_block
        if self._team is None and start is not None and index >= start:
            self._team = Team(self._config, self._gossip, start, self._history)
            self._history = {}
        if self._team is not None:
            return self._team.step(index, samples, inbox)
        self._update_pairs(self._history.get(index - 1), inbox)
        if index % self._look_every == 0:
            self._announce(index)
        self._history.pop(index - self._history_length, None)
        if samples is None:
            return {}
        self._history[index] = samples
        return {"kinematics": samples[:, KINEMATICS]}

    def belief(self) -> Belief:
        """See ``Estimator.belief``."""
        poses = {} if self._team is None else self._team.neighbours_poses()
        if self._team is None or not poses:
            poses = {name: self._pair(name) for name in self._pairs if self._pairs[name].count > 1.0}
            return Belief("poses", False, None, _seen(poses), not_observable=_unseen(poses))
        payload, unseen = self._team.payload()
        return Belief(
            phase="inertia",
            converged=payload is not None and not unseen and is_converged(payload, self._config.converged),
            payload=payload,
            poses=_seen(poses),
            total_block=self._team.total_block,
            total_wrench=self._team.total_wrench,
            not_observable=_unseen(poses) + unseen,
            load_changes=tuple(self._team.load_changes),
        )

    def _update_pairs(self, previous: Array | None, inbox: Mapping[str, Channels]) -> None:
        for name, channels in inbox.items():
            kinematics = channels.get("kinematics")
            if kinematics is not None and previous is not None:
                self._pairs[name] += TwistMoments.of(previous[:, :6], kinematics[:, :6])

    def _pair(self, name: str) -> PoseEstimate:
        return register_twists(self._pairs[name], self._config.noise, self._config.noise)

    def _announce(self, index: int) -> None:
        """Once the own pose in the body frame is roughly known, tell it, and a start far enough ahead for all."""
        graph, name = self._gossip.graph, self._config.name
        if graph is None or self._gossip.records[name].ready_block >= 0:
            return
        pose = self._own_pose(graph)
        if pose is not None:
            self._gossip.announce_ready(index + 2 * len(graph), pose)

    def _own_pose(self, graph: Mapping[str, tuple[str, ...]]) -> Pose | None:
        """Own pose in the body frame: through the neighbour that is next on the way to the reference robot."""
        name, reference = self._config.name, min(graph)
        if name == reference:
            return Pose.identity()
        hops = distances(graph, reference)
        parent = min(other for other in graph[name] if hops[other] == hops[name] - 1)
        parents_pose = self._gossip.pose(parent)
        if parents_pose is None or self._pairs[parent].count <= 1.0:
            return None
        pair = self._pair(parent)
        limits = self._config.efficient
        if (
            pair.unseen
            or np.degrees(pair.rotation_std) > limits.start_rotation_deg
            or 1e3 * pair.translation_std > limits.start_translation_mm
        ):
            return None
        return parents_pose @ pair.pose.inverse()


def _seen(poses: Mapping[str, PoseEstimate]) -> dict[str, UncertainPose]:
    """Those of which all is known: for the others no number is claimed."""
    return {name: pose for name, pose in poses.items() if not pose.unseen}


def _unseen(poses: Mapping[str, PoseEstimate]) -> tuple[str, ...]:
    """What is not known of the poses, and what would show it, a sentence for each."""
    sentences = []
    for name, pose in sorted(poses.items()):
        if len(pose.unseen) == _DIRECTIONS:
            sentences.append(f"pose of {name}: not seen yet; the load has to move and turn")
        elif pose.unseen:
            parts = ", ".join(str(direction) for direction in pose.unseen)
            sentences.append(f"pose of {name}, {parts}: turn the load about other axes as well")
    return tuple(sentences)
