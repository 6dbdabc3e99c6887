"""The method at the Cramér-Rao bound, for one robot.

First, poses of the neighbours by maximum likelihood, and from neighbour to neighbour the robot's own pose in the frame
of the reference robot, the **body frame**. When everybody's is roughly known, the network's sums begin (``Team``):
everybody carries its own samples to the body frame with its own pose, so all rounds happen in one frame, and every
loop is closed by construction. The totals say how the body moves and what wrench moves it. Out of these come better
poses, again and again, with all samples since the start, and the load's inertia (``agents.load_memory.LoadMemory``).
"""

from __future__ import annotations

from collections.abc import Mapping

from agents.body_frame import BodyFrame
from agents.early_sums import EARLY
from agents.estimator import Belief, Channels, is_converged
from agents.load_changes import LoadChanges
from agents.team import Team
from coheft.estimation.measurement import KINEMATICS, MeasurementBlock
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.spatial import Array
from coheft.estimation.uncertain_pose import UncertainPose
from coheft.wire.config import AgentConfig
from consensus.gossip import Gossip

_DIRECTIONS = 6
_KINEMATICS_SIZE = 9
_PAIRS_EVERY = 0.1
"""Time between two looks at the neighbours' poses, before the sums begin [s]."""


class EfficientEstimator:
    """One robot's share of the efficient method. See ``agents.estimator.Estimator``."""

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        self._config = config
        self._gossip = gossip
        self._body_frame = BodyFrame(config, gossip)
        self._history_length = config.blocks(EARLY)
        self._look_every = config.blocks(_PAIRS_EVERY)
        self._history: dict[int, Array] = {}
        self._team: Team | None = None
        self._team_number = self._frame = 0
        self._holds: dict[str, int] = {}
        self._load_changes = LoadChanges(config)

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """See ``Estimator.step``."""
        samples = None if own is None else own.samples
        if self._team is not None and self._team.must_start_over:
            self._gossip.announce_holding(True, index)  # as if it had just taken hold: with its pose unknown
        if self._team is not None and self._gossip.team != self._team_number:
            self._dissolve(self._team)
        start = self._gossip.start_block
        if self._team is None and start is not None and index >= start:
            self._team = self._assemble(start)
        if self._team is not None:
            return self._team.step(index, samples, inbox)
        return self._prepare(index, samples, inbox)

    def _prepare(self, index: int, samples: Array | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """A block without sums: find out the own pose in the body frame."""
        self._body_frame.update_pairs(index - 1, self._history.get(index - 1), inbox)
        self._body_frame.hear_kept_poses(inbox)
        self._announce(index)
        self._history = {block: rows for block, rows in self._history.items() if block > index - self._history_length}
        told = self._body_frame.channels()
        if samples is not None:
            self._history[index] = samples
            told["kinematics"] = samples[:, KINEMATICS]
        return told

    def _announce(self, index: int) -> None:
        """Once the own pose in the body frame is roughly known, tell it, and a start far enough ahead for all."""
        graph, own = self._gossip.graph, self._gossip.own
        if graph is None or (own.ready_block >= 0 and own.team == self._gossip.team):
            return
        known = self._body_frame.kept_pose()
        if known is None and index % self._look_every == 0:
            known = self._body_frame.found_pose()
        if known is not None:
            self._gossip.announce_ready(index + 2 * len(graph), *known)

    def _assemble(self, start: int) -> Team | None:
        """The team whose sums begin; None if somebody's pose is missing, or in another frame."""
        graph, frame = self._gossip.graph, self._gossip.frame()
        poses = {name: self._gossip.pose(name) for name in graph or ()}
        if graph is None or self._config.name not in graph:
            return None
        if any(pose is None or self._gossip.records[name].frame != frame for name, pose in poses.items()):
            return None
        # A load that was held by others weighed otherwise.
        earliest = max(record.since for record in self._gossip.records.values())
        history = {block: rows for block, rows in self._history.items() if block >= earliest}
        self._history = {}
        self._team_number, self._frame = self._gossip.team, frame
        self._holds = {name: self._gossip.records[name].since for name in graph}
        known = {name: pose for name, pose in poses.items() if pose is not None}
        return Team(self._config, graph, known, start, history, self._load_changes)

    def _dissolve(self, team: Team) -> None:
        """The team is another one now: keep what is known of the poses."""
        poses = team.poses_to_keep()
        if poses is None:
            self._body_frame.forget()
        else:
            self._body_frame.keep(self._frame, poses, self._holds)
        self._team = None

    def fits(self, channels: Channels) -> bool:
        """See ``Estimator.fits``."""
        if self._team is not None:
            return self._team.fits(channels)
        rows = channels.get("kinematics")
        return rows is None or rows.shape == (self._config.block, _KINEMATICS_SIZE)

    def belief(self) -> Belief:
        """See ``Estimator.belief``."""
        found = None if self._team is None else self._team.found()
        if self._team is None or found is None:
            poses = self._body_frame.neighbours_poses()
            return Belief(
                "poses",
                False,
                None,
                _seen(poses),
                not_observable=_unseen(poses),
                load_changes=self._load_changes.notices,
            )
        return Belief(
            phase="inertia",
            converged=found.payload is not None and is_converged(found.payload, self._config.converged),
            payload=found.payload,
            poses=_seen(found.poses),
            total_block=self._team.total_block,
            total_wrench=self._team.total_wrench,
            not_observable=_unseen(found.poses) + found.unseen,
            load_changes=self._load_changes.notices,
            learned_block=found.learned_block,
        )

    def doubts(self) -> tuple[str, ...]:
        """See ``Estimator.doubts``."""
        return ("the team's sums have not begun",) if self._team is None else self._team.doubts()


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
