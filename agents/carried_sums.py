"""The method at the Cramér-Rao bound, for one robot.

First, poses of the neighbours by maximum likelihood, and from neighbour to neighbour the robot's own pose in the frame
of the reference robot, the **body frame**. When everybody's is roughly known, the network's sums begin: everybody
carries its own samples to the body frame with its own pose, so all rounds happen in one frame, and every loop is closed
by construction. The totals say how the body moves, and out of that come better poses (``PoseSearch``). When these are
known well, the sums begin anew (``Team``), with the samples of the ten seconds before as well: poses become better
still, again and again, and what wrench moves the body says what the load is (``agents.load_memory.LoadMemory``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from agents import kinematics
from agents.body_frame import BodyFrame
from agents.early_sums import EARLY
from agents.estimator import Belief, Channels, is_converged
from agents.kept_load import KeptLoad
from agents.known_pose import KnownPose
from agents.load_changes import LoadChanges
from agents.pose_search import PoseSearch
from agents.regular import Regular
from agents.team import Team
from coheft.estimation.measurement import KINEMATICS, MeasurementBlock
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.uncertain_pose import UncertainPose
from coheft.wire.config import AgentConfig
from consensus.gossip import Gossip
from consensus.graph import hearing

_DIRECTIONS = 6
_TEAM = "team"
"""Channel that says of which team the others are."""
_LEFT = 32
"""So many teams that were left are remembered."""
_PAIRS_EVERY = 0.1
"""Time between two looks at the neighbours' poses, before the sums begin [s]."""


class EfficientEstimator:
    """One robot's share of the efficient method. See ``agents.estimator.Estimator``."""

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        self._config = config
        self._gossip = gossip
        self._body_frame = BodyFrame(config, gossip)
        self._history_length = config.blocks(EARLY)
        self._looks = Regular(config.blocks(_PAIRS_EVERY))
        self._history: dict[int, Array] = {}
        self._search: PoseSearch | None = None
        self._team: Team | None = None
        self._team_number = self._frame = 0
        self._left: deque[int] = deque(maxlen=_LEFT)
        self._holds: dict[str, int] = {}
        self._load_changes = LoadChanges(config)
        self._kept_load = KeptLoad()

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """See ``Estimator.step``."""
        samples = None if own is None else own.samples
        is_time_to_look = self._looks.is_due(index)
        at_work = self._team or self._search
        if at_work is not None and at_work.must_start_over and self._gossip.own.holding:
            self._body_frame.start_over(index)
            self._gossip.announce_holding(True, index)  # as if it had just taken hold: with its pose unknown
        if self._team_number not in (0, self._gossip.team):
            self._dissolve()
        start = self._gossip.start_block
        if self._search is None and self._team is None and start is not None and index >= start:
            self._assemble(start, index)
        if self._team is None:
            self._remember(index, samples)
        told = {_TEAM: np.array([float(self._team_number)])}
        inbox_of_team = {name: channels for name, channels in inbox.items() if self._is_of_team(channels)}
        if self._team is not None:
            return told | self._team.step(index, samples, inbox_of_team)
        if self._search is not None:
            return told | self._look_for_poses(self._search, index, samples, inbox_of_team)
        return told | self._prepare(index, samples, inbox, is_time_to_look)

    def _remember(self, index: int, samples: Array | None) -> None:
        """Own samples, for the sums that are to begin."""
        while self._history and (oldest := next(iter(self._history))) <= index - self._history_length:
            del self._history[oldest]
        if samples is not None:
            self._history[index] = samples

    def _look_for_poses(
        self, search: PoseSearch, index: int, samples: Array | None, inbox: Mapping[str, Channels]
    ) -> dict[str, Array]:
        told = search.step(index, samples, inbox)
        pose = None if self._gossip.own.refined else search.well_known_pose()
        if pose is not None:
            self._announce_pose(index, pose, self._frame, refined=True)
        return told

    def _prepare(
        self, index: int, samples: Array | None, inbox: Mapping[str, Channels], is_time_to_look: bool
    ) -> dict[str, Array]:
        """A block without sums: find out the own pose in the body frame."""
        self._body_frame.update_pairs(index - 1, self._history.get(index - 1), inbox)
        self._body_frame.hear_kept_poses(inbox)
        where = self._gossip.frame(), min(self._gossip.graph or ("",))
        self._kept_load.hear(inbox, where)
        self._announce(index, is_time_to_look)
        told = self._body_frame.channels() | self._kept_load.channels(where)
        if samples is not None:
            told[kinematics.CHANNEL] = samples[:, KINEMATICS]
        return told

    def _announce(self, index: int, is_time_to_look: bool) -> None:
        """Once the own pose in the body frame is known, tell it: one that is kept is known well, one found roughly."""
        if self._gossip.graph is None or (self._gossip.is_ready and self._gossip.own.frame == self._gossip.frame()):
            return
        kept = self._body_frame.kept_pose()
        if kept is not None:
            known, frame = kept
            self._announce_pose(index, known.pose, frame, refined=True, deviations=known.deviations)
        elif is_time_to_look:
            self._body_frame.forget_misfits(index)
            if self._body_frame.misfits:  # sums with these samples would contradict themselves
                self._history = {block: rows for block, rows in self._history.items() if block >= index}
            found = self._body_frame.found_pose()
            if found is not None:
                self._announce_pose(index, *found)

    def _announce_pose(
        self, index: int, pose: Pose, frame: int, refined: bool, deviations: Array | None = None
    ) -> None:
        """Tell it, and a start of the sums: a block at which, where nothing is lost, everybody has heard of it."""
        graph = self._gossip.graph
        if graph is not None:
            self._gossip.announce_ready(index + hearing(graph), pose, frame, refined, deviations)

    def _assemble(self, start: int, index: int) -> None:
        """The team's sums begin; not if somebody's pose is missing, or in another frame.

        Whoever left this team, by mistake, cannot come back to others' sums: then it has to be another team.
        """
        if self._gossip.team in self._left:
            if self._gossip.own.holding:
                self._gossip.announce_holding(True, index)
            return
        graph, frame = self._gossip.graph, self._gossip.frame()
        poses = {name: self._gossip.pose(name) for name in graph or ()}
        known = {name: pose for name, pose in poses.items() if pose is not None}
        if graph is None or self._config.name not in graph or len(known) < len(poses):
            return
        if any(self._gossip.records[name].frame != frame for name in graph):
            return
        self._team_number, self._frame = self._gossip.team, frame
        if not self._gossip.is_refined:
            refined = (name for name in sorted(graph) if self._gossip.records[name].refined)
            self._search = PoseSearch(self._config, graph, known, next(refined, min(graph)), start)
            self._kept_load.forget()
            return
        # A load that was held by others weighed otherwise.
        history = {block: rows for block, rows in self._history.items() if block >= self._gossip.changed_at}
        self._history = {}
        self._holds = {name: self._gossip.records[name].since for name in graph}
        members = {name: KnownPose.of(pose, self._gossip.deviations(name)) for name, pose in known.items()}
        load = self._kept_load.seen_in((frame, min(graph)))
        self._team = Team(self._config, graph, members, start, history, self._load_changes, load)

    def _dissolve(self) -> None:
        """The team is another one now: keep what is known of the poses, and of the load."""
        if self._team is not None:
            poses = self._team.poses_to_keep()
            if poses is None:
                self._body_frame.fall_back()
            else:
                self._body_frame.keep(self._frame, poses, self._holds)
                self._kept_load.keep((self._frame, min(poses)), self._team.known_load())
        self._left.append(self._team_number)
        self._team_number = 0
        self._search = self._team = None

    def _is_of_team(self, channels: Channels) -> bool:
        number = channels.get(_TEAM)
        return number is not None and int(number[0]) == self._team_number

    def fits(self, channels: Channels) -> bool:
        """See ``Estimator.fits``."""
        if _TEAM in channels and channels[_TEAM].shape != (1,):
            return False
        at_work = self._team or self._search
        if at_work is not None:
            return not self._is_of_team(channels) or at_work.fits(channels)
        return kinematics.are_readable(channels, self._config.block)

    def belief(self) -> Belief:
        """See ``Estimator.belief``."""
        found = None if self._team is None else self._team.found()
        if self._team is None or found is None:
            poses = (self._search and self._search.neighbours_poses()) or self._body_frame.neighbours_poses()
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
            grasps=self._team.poses,
        )

    def doubts(self) -> tuple[str, ...]:
        """See ``Estimator.doubts``."""
        at_work = self._team or self._search
        if at_work is not None:
            return at_work.doubts()
        misfits = (f"what {name} measures does not fit how this robot moves" for name in self._body_frame.misfits)
        return ("the team's sums have not begun", *misfits)


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
