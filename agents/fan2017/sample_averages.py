"""Total wrench and angular acceleration of each sample, by dynamic consensus (Fan et al., section VI)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from coheft.agents.estimator import Channels
from coheft.agents.fan2017.network import Network
from coheft.agents.fan2017.team_average import TeamAverage
from coheft.estimation.fan2017.angular_acceleration import AngularAcceleration, gyro_derivative
from coheft.estimation.fan2017.systematic import inputs_by_pose_error
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.wire.config import AgentConfig

_CHANNELS = 10
"""Per sample: force and torque, angular acceleration, and 1 where these were measured or 0 where made up."""
_EVERY = 5
"""One sample in this many is used for the effects of pose errors and lag."""


class TeamBlock(NamedTuple):
    """A block with the team's totals, in ``F_i``. For most numbers see ``JointRls.update``.

    Attributes:
        number: Its number.
        wrench: Total force and torque, shape (B, 6).
    """

    number: int
    w: Array
    a: Array
    alpha: Array
    wrench: Array
    by_pose_error: Array
    lag: Array


class SampleAverages:
    """One robot's part in this consensus.

    Args:
        config: The robot's settings.
        network: The team as the robot sees it.
    """

    def __init__(self, config: AgentConfig, network: Network) -> None:
        self._config, self._network, self._rounds = config, network, config.fan2017.rounds
        self._is_alpha_shared = config.fan2017.share_acceleration
        self.average = TeamAverage(network, "sums", (self._rounds, config.block, _CHANNELS), _transport)
        self._inputs = np.zeros((config.block, _CHANNELS))
        self._entered: dict[int, tuple[Array, Array]] = {}  # own alpha, and its error per unit of the own pose error

    def start(self, poses_j_in_i: Mapping[str, Pose]) -> None:
        """Start anew, with these poses of the neighbours."""
        self.average.start(poses_j_in_i)
        self._names = tuple(poses_j_in_i)
        with_accelerometers = self._config.fan2017.acceleration == "accelerometers"
        self._acceleration = AngularAcceleration(
            list(poses_j_in_i.values()), self._config.noise, self._config.rate, with_accelerometers
        )
        self._used_from: int | None = None

    @property
    def alpha_covariance(self) -> Array:
        """Covariance of the noise of alpha, shape (3, 3), by the data sheet of the sensors."""
        return self._acceleration.covariance / (self._network.members if self._is_alpha_shared else 1)

    def step(
        self, index: int, blocks: Mapping[int, Array], received: Mapping[str, Array], inbox: Mapping[str, Channels]
    ) -> TeamBlock | None:
        """Enter block ``index - 1``; return the block that leaves if it can be used.

        That is so if the initial disagreement has shrunk, no message was lost, and all robots have measured it.
        """
        if self._used_from is None:
            passes = -(-self._network.mixing_rounds // self._rounds)
            self._used_from = index + self._rounds * passes
        self._enter(index - 1, blocks, received)
        after, leaving = self.average.step(self._inputs, inbox), index - 1 - self._rounds
        if after is None or index < self._used_from or leaving not in self._entered:
            return None
        extrapolation, before = self._network.extrapolation, self.average.before_last_round
        average = extrapolation.settled(after, before)
        # The mean of the last channel is 1 if all robots have measured the block, and 1 - 1/N if one has not.
        if np.abs(1.0 - average[:, 9]).max() >= 0.5 / self._network.members:
            return None
        return self._with_totals(leaving, blocks[leaving], average, extrapolation.left * (after - before))

    def _enter(self, index: int, blocks: Mapping[int, Array], received: Mapping[str, Array]) -> None:
        """Set this robot's inputs of a block; those of the last one if a measurement is missing."""
        self._entered = {k: each for k, each in self._entered.items() if k in blocks}
        near = [blocks.get(index + offset) for offset in (-1, 0, 1)]
        if any(block is None for block in near) or not received.keys() >= set(self._names):
            self._inputs = self._inputs.copy()
            self._inputs[:, 9] = 0.0
            return
        before, block, after = (block for block in near if block is not None)
        derivative = gyro_derivative(before[-1, :3], block[:, :3], after[0, :3], self._config.rate)
        others = [received[name][:, 6:9] for name in self._names]
        alpha = self._acceleration.estimate(derivative, block[:, :3], block[:, 6:9], others)
        self._inputs = np.hstack([block[:, 9:15], alpha, np.ones((len(block), 1))])
        self._entered[index] = alpha, self._alpha_by_pose_error(block[:, :3], alpha, others)

    def _alpha_by_pose_error(self, gyro: Array, alpha: Array, others: list[Array]) -> Array:
        """Return the error of the angular acceleration per unit error of the own pose, of some samples: (b, 3, 6).

        With ``A_i`` that of ``alpha_i``, the mean of all robots has ``(A_i + A_i) / N``: a neighbour sees this robot as
        it sees the neighbour, the other way round, so that the errors of all ``alpha_j`` add up to ``A_i`` as well. If
        ``alpha_i`` is used alone, errors of the neighbours' poses have the same variance: ``sqrt(1 + 1) A_i``.
        """
        factor = 2.0 / self._network.members if self._is_alpha_shared else np.sqrt(2.0)
        others = [other[::_EVERY] for other in others]
        return factor * self._acceleration.by_pose_error(gyro[::_EVERY], alpha[::_EVERY], others)

    def _with_totals(self, index: int, samples: Array, average: Array, behind: Array) -> TeamBlock:
        """Return a block with its average and how far this may be behind, both of shape (B, 10)."""
        members, (own_alpha, alpha_by_pose_error) = self._network.members, self._entered[index]
        lag = np.zeros((len(samples[::_EVERY]), 12))
        lag[:, :6] = members * behind[::_EVERY, :6]
        if self._is_alpha_shared:
            lag[:, 9:] = behind[::_EVERY, 6:9]
        return TeamBlock(
            number=index,
            w=samples[:, :3],
            a=samples[:, 6:9],
            alpha=average[:, 6:9] if self._is_alpha_shared else own_alpha,
            wrench=members * average[:, :6],
            by_pose_error=inputs_by_pose_error((samples[:, 9:15] - average[:, :6])[::_EVERY], alpha_by_pose_error),
            lag=lag,
        )


def _transport(pose_j_in_i: Pose) -> Array:
    """``X_ij`` of samples (wrench, angular acceleration, 1)."""
    result = np.eye(_CHANNELS)
    result[:6, :6] = pose_j_in_i.adjoint()
    result[6:9, 6:9] = pose_j_in_i.rotation
    return result
