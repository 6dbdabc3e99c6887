"""Messages that the processes of a run send, as msgspec structs; ``codec`` converts them to bytes."""

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from coheft.wire.former_names import keep_present
from coheft.wire.scenario.network import LinkQuality
from coheft.wire.scenario.schema import MAX_ROBOTS

_Count = Annotated[int, Meta(ge=0, lt=2**62)]
"""A counter in a record: a larger one can still be sent."""
_Robot = Annotated[str, Meta(max_length=32)]


class Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all messages; see ``sent_as``."""

    code: ClassVar[int]
    in_header: ClassVar[tuple[str | None, str | None]] = (None, None)


M = TypeVar("M", bound=Message)


def sent_as(code: int, *, block: str | None = None, number: str | None = None) -> Callable[[type[M]], type[M]]:
    """Define how a kind of message is sent: its code, which is unique and never reused for another kind, and the names
    of fields that are sent as the header's ``block`` and ``number``, see ``frame``.
    """

    def define(kind: type[M]) -> type[M]:
        kind.code, kind.in_header = code, (block, number)
        return kind

    return define


# --- robot plane: server <-> one robot ---------------------------------------------------------------------------


@sent_as(1, number="attempt")
class Ready(Message, frozen=True):
    """Robot to server: asks for measurements.

    Attributes:
        missing: Its neighbours that it is not linked with yet. A run begins when no robot misses a neighbour; a robot
            that returns to a run in progress receives measurements at once.
        attempt: Grows whenever the robot begins to ask anew, because it has started or lost its link; it has forgotten
            earlier measurements.
    """

    robot: str
    missing: list[str] = []
    attempt: int = 0


@sent_as(2, block="block", number="attempt")
class Measurements(Message, frozen=True):
    """Server to robot: its own sensors' samples of one block, see ``MeasurementBlock``.

    Attributes:
        block: Index of the block; grows, with gaps if blocks were missed.
        samples: Shape (B, 15).
        world: Number of the simulated world; a new one means that the server has restarted, and all learned is void.
        attempt: ``attempt`` of the robot's ``Ready``; measurements of an earlier attempt are not used.
        estimator: Estimator to use from this block on, the same for all robots; empty for that of its configuration.
    """

    robot: str
    block: int
    samples: np.ndarray[Any, Any]
    world: int = 0
    attempt: int = 0
    holding: bool = True
    estimator: str = ""

    def __post_init__(self) -> None:
        keep_present(self)


@sent_as(3, block="block", number="answers")
class Reference(Message, frozen=True):
    """Robot to server: answers one block of measurements, with what the arm shall do ``lag`` blocks later.

    Attributes:
        block: The block to which the reference applies.
        answers: The block of measurements that it answers.
        motion: Shape (B, 12): displacement from the home pose, rotation vector [rad] then position [m] in the axes of
            the home frame, and the rates of both.
        wrench: Feed-forward wrench ``(f, t)`` on the payload in ``F_i``, shape (6,) [N, N·m].
    """

    robot: str
    block: int
    answers: int
    motion: np.ndarray[Any, Any]
    wrench: np.ndarray[Any, Any]


@sent_as(4)
class Stop(Message, frozen=True):
    """Server to robot: the run is over."""

    reason: str


# --- neighbour plane: agent <-> agent along an edge --------------------------------------------------------------


@sent_as(10, number="incarnation")
class Hello(Message, frozen=True):
    """Agent to each neighbour: announces the sender, and the neighbours whose messages it receives.

    Sent twice per second, however long steps take; more often while there are no measurements; and at once when a link
    comes up, or in answer to a neighbour that does not receive the sender's messages yet.
    """

    sender: str
    heard: list[str]
    incarnation: int = 0


class LinkState(msgspec.Struct, frozen=True, forbid_unknown_fields=True, order=True):
    """A robot's record about itself, forwarded from neighbour to neighbour to all robots.

    Attributes:
        sequence: Grows with every change; within an incarnation the highest wins.
        ready_block: Block from which it can take part in the sums of a team; -1 while it cannot.
        incarnation: Grows when the robot's agent restarts with an empty memory; the highest wins.
        holding: Whether it holds the load. A robot whose agent is dead still holds what it held.
        since: Block from which ``holding`` has its value.
        team: Checksum of the membership that it is ready for, see ``coheft.consensus.gossip``.
        signature: The robot's signature of all of the above, in the secure profile.
        certificate: The robot's certificate (DER), in the secure profile, for robots that are not its neighbours.
    """

    robot: _Robot
    sequence: _Count
    neighbours: Annotated[tuple[_Robot, ...], Meta(max_length=MAX_ROBOTS)]
    ready_block: Annotated[int, Meta(ge=-1, lt=2**62)] = -1
    incarnation: _Count = 0
    holding: bool = True
    since: _Count = 0
    team: Annotated[int, Meta(ge=0, lt=2**32)] = 0
    signature: bytes = b""
    certificate: bytes = b""


@sent_as(11, block="block", number="incarnation")
class NeighbourMessage(Message, frozen=True):
    """Agent to each neighbour, once per block.

    Attributes:
        block: The block after which it was sent.
        gossip: New records about robots, see ``LinkState``.
        channels: The estimator's arrays by name; the estimator defines their frames.
        incarnation: Grows when the sender restarts with an empty memory; messages of earlier incarnations are void.
    """

    sender: str
    block: int
    gossip: list[LinkState]
    channels: dict[str, np.ndarray[Any, Any]]
    incarnation: int = 0


# --- observer plane: server and agents -> observers; agents cannot receive it ------------------------------------


class PayloadEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mass [kg] and other mass properties of the payload in ``F_i`` with their covariance, as far as observable.

    Attributes:
        com: Centre of mass (3,) [m], None while a direction is unobservable.
        tensor: Inertia (3, 3) about the centre of mass [kg·m²], None while a part of it or the centre of mass is
            unobservable.
        covariance: Covariance (k, k) of the known part of ``(m, h, J packed as xx yy zz xy xz yz)``, k = 1, 4 or 10.
    """

    mass: float
    com: np.ndarray[Any, Any] | None
    tensor: np.ndarray[Any, Any] | None
    covariance: np.ndarray[Any, Any]


class PoseEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Pose of a neighbour's grasp frame in the robot's own.

    Attributes:
        rotation: ``R_ij`` (3, 3).
        translation: ``p_ij`` (3,) [m].
        covariance: (6, 6) of (rotation vector in the axes of ``F_i`` [rad], translation [m]).
    """

    rotation: np.ndarray[Any, Any]
    translation: np.ndarray[Any, Any]
    covariance: np.ndarray[Any, Any]


class LoadChangeNotice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Notice of a load change: noticed after ``noticed_at`` [s], happened at about ``changed_at`` [s]."""

    noticed_at: float
    changed_at: float


class SlipNotice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Notice of a slipped grasp.

    Attributes:
        named_at: When it was distinguished from a change of the load [s].
        slipped_at: Approximate time of the slip [s].
    """

    robot: str
    noticed_at: float
    named_at: float
    slipped_at: float


class SensorErrorEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A robot's estimate of one constant error of its sensors.

    Attributes:
        key: Name of the error, as in ``sensors.tolerance``.
        axis: Axis of the grasp frame; two letters for cross-talk, empty if the error has no axis.
        value: Estimate in the unit of the key.
        std: Its standard deviation.
        told: The standard deviation in the tolerance.
    """

    key: str
    axis: str
    value: float
    std: float
    told: float


class Validity(StrEnum):
    """Whether an agent's estimate may be relied upon."""

    STARTING = "starting"
    """There is no estimate of the payload yet."""
    VALID = "valid"
    """The truth is within five of the estimate's own standard deviations."""
    STALE = "stale"
    """The agent cannot know whether its last valid estimate still holds."""


@sent_as(20, block="block")
class Estimate(Message, frozen=True):
    """An agent's estimate after one block.

    Attributes:
        block: The last block that it had processed.
        time: End of that block [s].
        phase: ``poses`` while relative poses are being found, then ``inertia``.
        converged: Whether all standard deviations are within the scenario's limits.
        members: Size of the team as learned by gossip, 0 while unknown.
        payload: Mass properties in ``F_i``, None while unknown.
        poses: Neighbours' grasp frames in ``F_i``.
        total_block: Block to which ``total_wrench`` belongs, -1 if none.
        total_wrench: Total wrench (6,) about the origin of ``F_i``, as sensors read it, at the end of ``total_block``:
            with ``efficient`` the mean over its newest row, with ``fan2017`` of its last sample.
        not_observable: Descriptions of parameters that the motion so far does not show.
        status: Whether the estimate may be relied upon; if it is stale, payload and poses are the last valid ones.
        reasons: Why it is not valid, or has not converged, in words, for instance "r3 is silent since 12.34 s".
        valid_block: Block to which payload and poses belong, the last valid one when stale; -1 if there is none.
        disturbed: Links that the operator has disturbed, by the neighbour that sends.
    """

    robot: str
    block: int
    time: float
    phase: Literal["poses", "inertia"]
    converged: bool
    members: int
    payload: PayloadEstimate | None
    poses: dict[str, PoseEstimate]
    total_block: int
    total_wrench: np.ndarray[Any, Any]
    not_observable: list[str]
    load_changes: list[LoadChangeNotice]
    problems: int = 0
    status: Validity = Validity.STARTING
    reasons: list[str] = []
    valid_block: int = -1
    silent: list[str] = []
    estimator: str = ""
    sensor_errors: list[SensorErrorEstimate] = []
    slips: list[SlipNotice] = []
    disturbed: dict[str, LinkQuality] = {}

    def __post_init__(self) -> None:
        keep_present(self)

    @property
    def is_converged(self) -> bool:
        """Whether the estimate has converged and is valid."""
        return self.converged and self.status is Validity.VALID


@sent_as(23)
class EstimateBeside(Message, frozen=True):
    """Agent to observers: an estimate made beside the robot's own, on the same samples, by the estimator it names."""

    estimate: Estimate

    @property
    def robot(self) -> str:
        """The robot."""
        return self.estimate.robot

    @property
    def time(self) -> float:
        """End of the block after which it was made [s]."""
        return self.estimate.time


@sent_as(21)
class Problem(Message, frozen=True):
    """Report that a process, ``source``, refused something; or, if ``is_end``, why the run ends, which the supervisor
    learns from the process itself.
    """

    source: str
    text: str
    is_end: bool = False
