"""The inertial phase of Fan et al., sections VI and VII, for one robot.

Total wrench and angular acceleration by dynamic consensus, and mass properties by joint least squares with forgetting,
on which robots agree.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from coheft.agents.estimator import Channels
from coheft.agents.fan2017.agreement import Agreed, Agreement
from coheft.agents.fan2017.claims import claim
from coheft.agents.fan2017.mean_moves import MeanMoves
from coheft.agents.fan2017.network import Network
from coheft.agents.fan2017.sample_averages import SampleAverages, TeamBlock
from coheft.consensus.graph import Neighbours
from coheft.estimation.fan2017.joint_rls import JointRls
from coheft.estimation.fan2017.systematic import covariance_by_own_pose, covariance_by_poses, pose_error_covariance
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.wire.config import AgentConfig, KnownPayload
from coheft.wire.messages.structs import LoadChangeNotice, PayloadEstimate

_SURPRISE = 9.0
"""A block is surprising when the mean square of its normalised residuals is so many times the usual one."""
_SURPRISED_BLOCKS = 2
"""So many surprising blocks in a row are a load change."""
_SETTLED = 1.0
"""None is noticed so soon after the filter has started or noticed one [s]."""
_MUCH_BETTER = 0.7
"""Poses are taken over when their standard deviations have fallen to this share: to start anew costs some blocks."""
_EVERY = 5
"""One block in this many is used for the covariance of pose errors, which changes slowly."""
_PATIENCE = 0.25
"""After so long without a complete sum, the load may have changed unnoticed [s]."""


class InertialPhase:
    """Sums over the network, and the joint filter fed by them; poses and team no longer change.

    Args:
        config: The robot's settings.
        graph: Of all robots that hold the load.
        poses_j_in_i: Of its neighbours among them, by name.
        load_changes: Those that are noticed are appended.

    Attributes:
        newest: The newest block whose totals have come, -1 while there is none.
        total_wrench: Total wrench (6,) about the origin of ``F_i`` at the last sample of the newest one.
    """

    def __init__(
        self,
        config: AgentConfig,
        graph: Neighbours,
        poses_j_in_i: Mapping[str, UncertainPose],
        load_changes: deque[LoadChangeNotice],
    ) -> None:
        self._config = config
        self._settings = config.fan2017
        self._rounds = self._settings.rounds
        self._network = Network.of(config, graph)
        self._samples = SampleAverages(config, self._network)
        self._agreement = Agreement(self._network, self._settings.initial_mass)
        self._moves = MeanMoves(self._network, self._rounds, config.blocks(self._settings.memory))
        self._averages = (self._samples.average, self._agreement.average, self._moves.average)
        self._by_pose_error = np.zeros((10, 10))
        self._filter: JointRls | None = None
        self._grasp_centre = np.zeros(3)
        self._quiet_until = np.inf
        self._first_agreed = 0
        """No sooner than this block have all robots agreed on any payload."""
        self.newest = -1
        self.total_wrench = np.zeros(6)
        self._load_changes = load_changes
        self._start_with(poses_j_in_i)

    def _start_with(self, poses_j_in_i: Mapping[str, UncertainPose]) -> None:
        """Freeze the neighbours' poses as they are, and start all sums."""
        self._poses = dict(sorted(poses_j_in_i.items()))
        poses = {name: each.pose for name, each in self._poses.items()}
        self._length = float(np.sqrt(np.mean([pose.translation @ pose.translation for pose in poses.values()])))
        for each in (self._samples, self._agreement, self._moves):
            each.start(poses)
        self._surprised = 0
        self._next: int | None = None
        self._agreed_at: int | None = None

    def is_worth_taking_over(self, poses_j_in_i: Mapping[str, UncertainPose]) -> bool:
        """Whether the neighbours' poses are known so much better by now that all sums should restart."""
        return all(_share(poses_j_in_i[name], used) < _MUCH_BETTER for name, used in self._poses.items())

    def take_over(self, poses_j_in_i: Mapping[str, UncertainPose]) -> None:
        """Restart the sums with the present poses; estimates stay.

        Whenever sums start, all robots do this, so that both ends of an edge use the same pose.
        """
        better = min(1.0, max(_share(poses_j_in_i[name], used) for name, used in self._poses.items()))
        self._start_with(poses_j_in_i)
        if self._filter is not None:
            self._filter.note_better(better)

    @property
    def is_broken(self) -> bool:
        """Whether a neighbour's message was lost, so that every robot has to start the sums anew."""
        return any(each.is_broken for each in self._averages)

    def step(
        self, index: int, blocks: Mapping[int, Array], received: Mapping[str, Array], inbox: Mapping[str, Channels]
    ) -> None:
        """Let block ``index - 1`` enter the sums, and take in the one that leaves them."""
        if self._next not in (None, index):
            for each in self._averages:
                each.miss_block()
        self._next = index + 1
        if self._agreed_at is None:
            self._agreed_at = index + self._network.mixing_rounds
        block = self._samples.step(index, blocks, received, inbox)
        if block is not None:
            self._take_in(block, index)
        self._moves.step(self._filter, block is not None, inbox)
        has_mixed = self._filter is None or index >= self._agreed_at
        self._agreement.step(self._own_estimate(index), inbox, has_mixed=has_mixed)

    def _own_estimate(self, index: int) -> tuple[Array, Array, Array, Array] | None:
        if self._filter is None:
            return None
        if index % _EVERY == 0:
            pose_error = pose_error_covariance(list(self._poses.values()), self._filter.theta[6:9])
            self._by_pose_error = covariance_by_own_pose(self._filter.by_pose_error, pose_error)
        return self._filter.theta, self._filter.by_lag, self._filter.by_old, self._by_pose_error

    def channels(self) -> dict[str, Array]:
        """What to send to the neighbours."""
        return {name: values for each in self._averages for name, values in each.channels().items()}

    def payload(self) -> tuple[PayloadEstimate, tuple[str, ...]] | None:
        """The robots' agreed estimate with its covariance, and why it has not converged, if it has not."""
        if self._filter is None or self._next is None or self._next <= self._first_agreed:
            return None
        agreed = self._agreed(self._filter)
        if agreed.theta[9] <= 0.0 or self._filter.theta[9] <= 0.0:
            return None
        pose_error = pose_error_covariance(list(self._poses.values()), self._filter.theta[6:9])
        by_poses = covariance_by_poses(
            self._filter.theta, self._filter.by_pose_error, pose_error, agreed.by_pose_error, self._network.members
        )
        share = self._moves.noise.share if self._settings.share_estimates else None
        return claim(self._filter, agreed, share, by_poses, self._length, self._config.converged)

    def _agreed(self, own: JointRls) -> Agreed:
        """What all robots agree on. What is known beforehand needs no agreement: frozen poses would make it wrong."""
        agreed = self._agreement.agreed
        if not self._settings.share_estimates:
            return replace(agreed, theta=own.theta, behind=np.zeros(10), by_lag=own.by_lag, by_old=own.by_old)
        is_known = np.isin(np.arange(10), list(_known(self._config.known)))
        theta, behind = np.where(is_known, own.theta, agreed.theta), np.where(is_known, 0.0, agreed.behind)
        return replace(agreed, theta=theta, behind=behind)

    def doubt(self, block: int) -> str | None:
        """Why the load may be further off than is claimed, at the start of a block; None if there is no reason."""
        if not self._network.knows_lag:
            return f"fan2017.rounds = {self._rounds} is too small to tell how far the team's sums lag behind"
        if block - 1 - self._rounds - self.newest > self._config.blocks(_PATIENCE):
            return f"no complete sum of the team since {self._config.start_of(self.newest + 1):.2f} s"
        return "wrenches no longer fit the load: it may have changed" if self._surprised else None

    def _take_in(self, block: TeamBlock, index: int) -> None:
        self.newest, self.total_wrench = block.number, block.wrench[-1]
        if self._filter is None:
            self._grasp_centre = self._agreement.centre
            centre = self._grasp_centre if self._settings.initial_com == "centre" else np.zeros(3)
            self._filter = self._new_filter(centre)
            self._quiet_until = self._config.start_of(index) + _SETTLED
            self._first_agreed = index + self._network.mixing_rounds
        mean_com = None
        if self._settings.share_acceleration and self._settings.share_estimates:
            mean_com = self._filter.theta[6:9] - self._grasp_centre
        force, torque = block.wrench[:, :3], block.wrench[:, 3:]
        self._filter.update(block.w, block.a, block.alpha, force, torque, block.by_pose_error, block.lag, mean_com)
        self._watch_for_change(block.number, index, self._filter.surprise)

    def _watch_for_change(self, leaving: int, index: int, surprise: float) -> None:
        self._surprised = self._surprised + 1 if surprise > _SURPRISE else 0
        if self._surprised:
            self._moves.noise.pause(self._rounds)
        if self._surprised >= _SURPRISED_BLOCKS and self._config.start_of(index) > self._quiet_until:
            changed_at = self._config.start_of(leaving + 1 - self._surprised)
            self._load_changes.append(LoadChangeNotice(self._config.start_of(index + 1), changed_at))
            assert self._filter is not None
            self._filter.note_change()
            self._quiet_until = self._config.start_of(index) + self._settings.memory + _SETTLED

    def _new_filter(self, centre: Array) -> JointRls:
        """The joint filter. Until it has measured how large noise is, it takes all robots to be like its neighbours."""
        noise, n = self._config.noise, self._network.members
        torque_variance = noise.torque**2 + 2.0 / 3.0 * (noise.force * self._length) ** 2
        wrench_covariance = np.diag(np.repeat([n * noise.force**2, n * torque_variance], 3))
        motion_covariance = np.zeros((6, 6))
        motion_covariance[:3, :3] = noise.acceleration**2 * np.eye(3)
        motion_covariance[3:, 3:] = self._samples.alpha_covariance
        return JointRls(
            centre,
            wrench_covariance,
            motion_covariance,
            forgetting=1.0 - 1.0 / (self._settings.memory * self._config.rate),
            mass=self._settings.initial_mass,
            known=_known(self._config.known),
            is_weighted_by_state=self._settings.equation_weights == "proposition-2",
        )


def _share(pose: UncertainPose, used: UncertainPose) -> float:
    return pose.translation_std / used.translation_std


def _known(payload: KnownPayload) -> dict[int, float]:
    """What is known beforehand of theta ``(J, h, 1/m)``, by index."""
    known = dict(enumerate(payload.inertia or ())) | dict(enumerate(payload.com or (), start=6))
    return known if payload.mass is None else known | {9: 1.0 / payload.mass}
