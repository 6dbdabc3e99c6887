"""The method of Fan et al., sections V to VII, for one robot.

First, relative poses of the neighbours by dual-quaternion least squares. When all have converged, the poses are
frozen and the inertial phase begins: total wrench and angular acceleration by dynamic consensus, mass properties by
joint least squares with forgetting, and consensus over the robots' estimates.
"""

from collections import deque
from collections.abc import Mapping

import numpy as np

from coheft.agents.estimator import MOST_NOTICES, Belief, Channels
from coheft.agents.fan2017.inertial_phase import InertialPhase
from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import Neighbours
from coheft.estimation.fan2017.pose_rls import PoseRls
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.measurement import KINEMATICS, KINEMATICS_SIZE, MeasurementBlock
from coheft.estimation.tolerance import SensorDrift, SensorTolerance
from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import LoadChangeNotice

_CHANNEL = "kinematics"
"""Channel of the twists and accelerations of a block's samples, columns ``KINEMATICS``, shape (B, 9)."""
_SOLVE_EVERY = 5
"""Blocks per solution of a pose filter: poses do not change, and solving costs more than taking in."""

_SENSORS = (
    "the payload: [sensors] declares errors that the method of Fan et al. (2017) does not model, so it has no standard "
    "deviations; the estimator efficient models them, and with --set 'sensors.tolerance={}' sensors are exact"
)

_UNOBSERVABLE_DEG = 20.0
"""A pose whose rotation is less certain than this is reported as not observed [degrees]."""


class Fan2017Estimator:
    """One robot's estimator by the method of Fan et al. See ``coheft.agents.estimator.Estimator``."""

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        self._config = config
        self._settings = config.fan2017
        self._gossip = gossip
        self._load_changes: deque[LoadChangeNotice] = deque(maxlen=MOST_NOTICES)
        self._may_sensors_be_off = (
            config.tolerance != SensorTolerance()
            or config.drift != SensorDrift()
            or config.noise_correlation > 0.0
            or bool(config.unequal)
        )
        # Of neighbours while both hold the load. Both ends of an edge run the same filter on the same numbers, if none
        # are lost, and take each other's inverse: so the transports of an edge are exactly inverse to each other, as
        # Proposition 3 demands.
        self._filters: dict[str, PoseRls] = {}
        self._holds: dict[str, tuple[int, int, int]] = {}  # incarnation, and since when it and this robot hold
        self._blocks: dict[int, Array] = {}
        self._inertial_phase: InertialPhase | None = None
        self._started: int | None = None
        """The block after which the sums started last."""
        self._team = 0
        self._index = -1

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """See ``Estimator.step``."""
        previous = self._blocks.get(index - 1)
        received = {name: channels[_CHANNEL] for name, channels in inbox.items() if _CHANNEL in channels}
        self._follow_holds()
        if previous is not None:
            for name in received.keys() & self._filters.keys():
                if index - 1 >= max(self._holds[name][1:]):  # else one of them was still elsewhere
                    self._update_pose(name, previous[:, :6], received[name][:, :6])
        if own is not None:
            self._blocks[index] = own.samples
        kept = index - self._settings.rounds - 3
        self._blocks = {block: rows for block, rows in self._blocks.items() if block > kept}
        sent = {} if own is None else {_CHANNEL: own.samples[:, KINEMATICS]}

        if self._gossip.membership != self._team:  # one of its members started again, let go, or took hold
            self._team, self._inertial_phase = self._gossip.membership, None
        self._index = index
        graph, start = self._gossip.graph, self._gossip.start_block
        if graph is None or self._config.name not in graph:
            return sent
        phase = self._inertial_phase
        is_waiting = start is None or index <= start
        if is_waiting and (phase is None or phase.is_broken):
            self._announce_poses(index, graph)
            return sent
        if phase is None:
            poses = {name: pose for name, pose in self._poses().items() if name in graph[self._config.name]}
            phase = self._inertial_phase = InertialPhase(self._config, graph, poses, self._load_changes)
        elif start != self._started and not is_waiting:
            phase.take_over(self._poses())
        if not is_waiting:
            self._started = start
        phase.step(index, self._blocks, received, inbox)
        is_solved = index % _SOLVE_EVERY == 0
        if not is_waiting and (phase.is_broken or (is_solved and phase.is_worth_taking_over(self._poses()))):
            self._announce_start(index, graph)
        return sent | phase.channels()

    def _follow_holds(self) -> None:
        """Restart the filter of a neighbour that has restarted, or has grasped the load again, maybe elsewhere."""
        own = self._gossip.own
        for name in self._config.neighbours:
            record = self._gossip.records.get(name)
            if record is None or not (record.holding and own.holding):
                self._filters.pop(name, None)
                self._holds.pop(name, None)
            elif self._holds.get(name) != (hold := (record.incarnation, record.since, own.since)):
                self._holds[name], self._filters[name] = hold, PoseRls(self._config.noise, solve_every=_SOLVE_EVERY)

    def fits(self, channels: Channels) -> bool:
        """See ``Estimator.fits``."""
        if any(array.dtype != np.float64 for array in channels.values()):
            return False
        return _CHANNEL not in channels or channels[_CHANNEL].shape == (self._config.block, KINEMATICS_SIZE)

    def belief(self) -> Belief:
        """See ``Estimator.belief``."""
        poses = self._poses()
        sensors = (_SENSORS,) if self._may_sensors_be_off else ()
        missing = sensors + tuple(
            f"pose of {name}: {_in_words(pose)}; the payload has to turn more, about at least two axes"
            for name, pose in sorted(poses.items())
            if not self._is_known(pose)
        )
        phase = self._inertial_phase
        if phase is None:
            return Belief("poses", False, None, poses, not_observable=missing, load_changes=tuple(self._load_changes))
        claim = None if self._may_sensors_be_off else phase.payload()
        return Belief(
            phase="inertia",
            converged=claim is not None and not claim[1],
            payload=None if claim is None else claim[0],
            shortfall=() if claim is None else claim[1],
            poses=poses,
            total_block=phase.newest,
            total_wrench=phase.total_wrench,
            not_observable=missing,
            load_changes=tuple(self._load_changes),
            learned_block=phase.newest,
        )

    def doubts(self) -> tuple[str, ...]:
        """See ``Estimator.doubts``."""
        phase = self._inertial_phase
        if phase is None:
            return ("the team's sums have not begun",)
        if phase.newest < 0:
            return ("the team's sums have just begun",)
        doubt = phase.doubt(self._index + 1)
        return () if doubt is None else (doubt,)

    def _update_pose(self, name: str, own: Array, other: Array) -> None:
        if self._config.name < name:
            self._filters[name].update(own, other)
        else:
            self._filters[name].update(other, own)

    def _poses(self) -> dict[str, UncertainPose]:
        """Estimates of ``pose_j_in_i`` by neighbour."""
        own_name = self._config.name
        return {
            name: pose.estimate if own_name < name else pose.estimate.inverse() for name, pose in self._filters.items()
        }

    def _is_known(self, pose: UncertainPose) -> bool:
        return bool(
            np.degrees(pose.rotation_std) < self._settings.pose_rotation_deg
            and 1e3 * pose.translation_std < self._settings.pose_translation_mm
        )

    def _announce_poses(self, index: int, graph: Neighbours) -> None:
        """Once all poses are known, offer a start."""
        poses = self._poses()
        if not self._gossip.is_ready and all(self._is_known(poses[name]) for name in graph[self._config.name]):
            self._announce_start(index, graph)

    def _announce_start(self, index: int, graph: Neighbours) -> None:
        """Offer a start of the sums that lies far enough ahead for every robot to hear of it in time."""
        self._gossip.announce_ready(index + 2 * len(graph))


def _in_words(pose: UncertainPose) -> str:
    degrees, millimetres = np.degrees(pose.rotation_std), 1e3 * pose.translation_std
    if degrees > _UNOBSERVABLE_DEG:
        return "not seen yet"
    return f"known to {degrees:.2g} degrees and {millimetres:.0f} mm only"
