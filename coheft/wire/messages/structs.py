"""Every message that crosses a process boundary, as msgspec structs; ``codec`` turns them into bytes."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import msgspec
import numpy as np

from coheft.wire.former_names import keep_present
from coheft.wire.messages.scene import SlippedGrasp


class Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all messages.

    Attributes:
        code: Of its kind; no two have the same, and none that is in use gets another meaning.
        in_header: Names of its fields that travel as the header's ``block`` and ``number``, see ``frame``.
        is_steady: Whether its other fields, numbers of arrays aside, hardly ever change.
    """

    code: ClassVar[int]
    in_header: ClassVar[tuple[str | None, str | None]] = (None, None)
    is_steady: ClassVar[bool] = False


# --- robot plane: server <-> one robot ---------------------------------------------------------------------------


class Ready(Message, frozen=True):
    """Robot to server: give me measurements.

    Attributes:
        robot: Who asks.
        missing: Its neighbours that it cannot talk with yet. A run begins when no robot misses another; a robot that
            comes back to one that goes on gets measurements at once.
        attempt: Grows whenever it begins to ask anew, because it has started or lost its link: it has forgotten what it
            was sent before.
    """

    code: ClassVar[int] = 1
    in_header: ClassVar[tuple[str | None, str | None]] = (None, "attempt")

    robot: str
    missing: list[str] = []
    attempt: int = 0


class Measurements(Message, frozen=True):
    """Server to robot: its own sensors' samples of one block, see ``MeasurementBlock``.

    Attributes:
        robot: Whose sensors.
        block: Grows; some may be missing.
        samples: Shape (B, 15).
        world: Number of the simulated world. Another one means that the server has started again: nothing that was
            learned of the old world holds.
        attempt: Of the robot's ``Ready``, by which it knows measurements that were meant for it before it asked anew.
        holding: Whether its hand held the payload during the block.
        estimator: Which one to use from this block on, the same for all robots; empty: that of its configuration.
    """

    code: ClassVar[int] = 2
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", "attempt")
    is_steady: ClassVar[bool] = True

    robot: str
    block: int
    samples: np.ndarray[Any, Any]
    world: int = 0
    attempt: int = 0
    holding: bool = True
    estimator: str = ""

    def __post_init__(self) -> None:
        keep_present(self)


class Reference(Message, frozen=True):
    """Robot to server: the answer to one block of measurements, and what its arm shall do ``lag`` blocks later.

    Attributes:
        block: The block for which the reference holds.
        answers: The block of measurements that this answers.
        motion: Shape (B, 12): displacement from the home pose, rotation vector [rad] then position [m] in the axes of
            the home frame, and the rates of both.
        wrench: Feed-forward wrench ``(f, t)`` on the payload in ``F_i``, shape (6,) [N, N·m].
    """

    code: ClassVar[int] = 3
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", "answers")
    is_steady: ClassVar[bool] = True

    robot: str
    block: int
    answers: int
    motion: np.ndarray[Any, Any]
    wrench: np.ndarray[Any, Any]


class Stop(Message, frozen=True):
    """Server to robot: the run is over."""

    code: ClassVar[int] = 4

    reason: str


# --- neighbour plane: agent <-> agent along an edge --------------------------------------------------------------


class Hello(Message, frozen=True):
    """Agent to each neighbour: I am here, and these neighbours I have heard.

    Twice a second, however long steps take; more often while there are no measurements; and at once when a link comes
    up, or in answer to one who does not hear the sender yet.

    Attributes:
        sender: Who speaks.
        heard: Whom it has heard.
        incarnation: As in ``NeighbourMessage``.
    """

    code: ClassVar[int] = 10
    in_header: ClassVar[tuple[str | None, str | None]] = (None, "incarnation")
    is_steady: ClassVar[bool] = True

    sender: str
    heard: list[str]
    incarnation: int = 0


class LinkState(msgspec.Struct, frozen=True, forbid_unknown_fields=True, order=True):
    """What one robot tells everyone about itself, handed on from neighbour to neighbour.

    Attributes:
        robot: Whom it is about.
        sequence: Grows with every change; within an incarnation the highest wins.
        neighbours: Names of its neighbours.
        ready_block: From this block on it can take part in the sums of a team; -1 while it cannot.
        incarnation: Grows when the robot's agent starts again with an empty memory; the highest wins.
        holding: Whether it has hold of the load. One whose agent is dead still holds what it held.
        since: Block from which this is so.
        team: Number of the membership that it is ready for, see ``coheft.consensus.gossip``.
        signature: Of the robot, over all of the above, in the secure profile.
        certificate: Of the robot (DER), in the secure profile: those who are no neighbours of it have not seen it.
    """

    robot: str
    sequence: int
    neighbours: tuple[str, ...]
    ready_block: int = -1
    incarnation: int = 0
    holding: bool = True
    since: int = 0
    team: int = 0
    signature: bytes = b""
    certificate: bytes = b""


class NeighbourMessage(Message, frozen=True):
    """Agent to each neighbour, once per block.

    Attributes:
        sender: Who speaks.
        block: The block after which it was sent.
        gossip: News about robots, see ``LinkState``.
        channels: The estimator's arrays by name; it says in which frame they are.
        incarnation: Grows when the sender starts again with an empty memory; what an older one said is void.
    """

    code: ClassVar[int] = 11
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", "incarnation")
    is_steady: ClassVar[bool] = True

    sender: str
    block: int
    gossip: list[LinkState]
    channels: dict[str, np.ndarray[Any, Any]]
    incarnation: int = 0


# --- observer plane: everyone -> whoever watches; agents cannot hear it -----------------------------------------


class PayloadEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mass properties of the payload in ``F_i`` with their covariance, as far as the motion has shown them.

    Attributes:
        mass: [kg].
        com: (3,) [m], None while a direction is unseen.
        tensor: (3, 3) at the centre of mass [kg·m²], None while a part of it or the centre of mass is unseen.
        covariance: (k, k) of what is there of ``(m, h, J packed as xx yy zz xy xz yz)``, k = 1, 4 or 10.
    """

    mass: float
    com: np.ndarray[Any, Any] | None
    tensor: np.ndarray[Any, Any] | None
    covariance: np.ndarray[Any, Any]


class PoseEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Pose of a neighbour's grasp frame in one's own.

    Attributes:
        rotation: ``R_ij`` (3, 3).
        translation: ``p_ij`` (3,) [m].
        covariance: (6, 6) of (rotation vector in the axes of ``F_i`` [rad], translation [m]).
    """

    rotation: np.ndarray[Any, Any]
    translation: np.ndarray[Any, Any]
    covariance: np.ndarray[Any, Any]


class LoadChangeNotice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An agent noticed that the load changed: noticed after ``noticed_at`` [s], changed at about ``changed_at`` [s]."""

    noticed_at: float
    changed_at: float


class SlipNotice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An agent noticed that a grasp has slipped.

    Attributes:
        robot: Whose.
        noticed_at: When something was found to have changed [s].
        named_at: When it was told from a change of the load [s].
        slipped_at: When it slipped, about [s].
    """

    robot: str
    noticed_at: float
    named_at: float
    slipped_at: float


class SensorErrorEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a robot has found out of one constant error of its sensors.

    Attributes:
        key: As in ``sensors.tolerance``.
        axis: Of the grasp frame; two letters for cross-talk, empty if the error has no axis.
        value: In the unit of the key.
        std: Its standard deviation.
        told: The standard deviation that the robot was told.
    """

    key: str
    axis: str
    value: float
    std: float
    told: float


class Estimate(Message, frozen=True):
    """What one agent believes after one block.

    Attributes:
        robot: Whose belief.
        block: The last block that it had seen.
        time: End of that block [s].
        phase: ``poses`` while relative poses are being found, then ``inertia``.
        converged: All numbers are known as well as the scenario asks.
        members: Size of the team as learned by gossip, 0 while unknown.
        payload: Mass properties in ``F_i``, None while unknown.
        poses: Neighbours' grasp frames in ``F_i``.
        total_block: Block to which ``total_wrench`` belongs, -1 if none.
        total_wrench: Total wrench (6,) about the origin of ``F_i``, as sensors read it, at the end of ``total_block``:
            with ``efficient`` the mean over its newest row, with ``seed`` of its last sample.
        not_observable: What the motion so far cannot tell, in words.
        load_changes: Changes of the load noticed so far.
        slips: Slips of grasps noticed so far.
        problems: Messages refused so far.
        status: ``starting`` until there is a first estimate of the payload. While it is ``valid``, the truth is within
            five of its own standard deviations. ``stale``: the agent cannot know whether it still holds; payload and
            poses are the last valid ones.
        reasons: Why it is not valid, or has not converged, in words, for instance "r3 is silent since 12.34 s".
        valid_block: Block to which payload and poses belong, the last valid one when stale; -1 if there is none.
        silent: Neighbours that it does not hear.
        estimator: By which method.
        sensor_errors: What it has found out of its sensors, where it was told that they may be off.
    """

    code: ClassVar[int] = 20
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", None)

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
    status: Literal["starting", "valid", "stale"] = "starting"
    reasons: list[str] = []
    valid_block: int = -1
    silent: list[str] = []
    estimator: str = ""
    sensor_errors: list[SensorErrorEstimate] = []
    slips: list[SlipNotice] = []

    def __post_init__(self) -> None:
        keep_present(self)

    @property
    def is_converged(self) -> bool:
        """Good enough, and valid."""
        return self.converged and self.status == "valid"


class Problem(Message, frozen=True):
    """A process refused something and went on, or the run ends: who, and why.

    Attributes:
        source: Whose words these are.
        text: What is wrong.
        is_end: The run ends with it; whoever supervises the run learns that from the process itself.
    """

    code: ClassVar[int] = 21

    source: str
    text: str
    is_end: bool = False


class PayloadTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """True mass properties in the payload's frame."""

    mass: float
    com: np.ndarray[Any, Any]
    tensor: np.ndarray[Any, Any]


class LoadState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A load on the payload.

    Attributes:
        id: Its number.
        mass: What there is of it [kg]; 0 when all has leaked away.
        position: Of its centre in the payload's frame [m].
        size: Its edge lengths [m].
        leak: What it loses [kg/s].
    """

    id: int
    mass: float
    position: tuple[float, float, float]
    size: tuple[float, float, float]
    leak: float = 0.0


class Truth(Message, frozen=True):
    """Server to observers, once per block; no agent can read it.

    Attributes:
        block: The block, all of whose samples were taken with this payload.
        time: End of the block [s].
        payload: True mass properties.
        loads: Loads that lie on the payload.
        position: Of the payload's frame in the world at the block's last sample, (3,) [m].
        quaternion: Its orientation, scalar first, (4,).
        total_wrench: Sum of the **measured** wrenches of the last sample, of all robots that hold it, carried with the
            true poses to the payload's frame, (6,).
        samples: What every robot measured last in the block, by robot in the order of the scene, (N, 15), each in its
            own frame, columns as in ``MeasurementBlock``.
        loads_since: Since when these loads, and no others, have lain there [s]: an observer may have missed blocks.
            None in recordings of protocol version 5, which do not say.
        slipped: Grasps that have slipped so far, by robot; all others are as in the scene.
    """

    code: ClassVar[int] = 22
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", None)

    block: int
    time: float
    payload: PayloadTruth
    loads: list[LoadState]
    position: np.ndarray[Any, Any]
    quaternion: np.ndarray[Any, Any]
    total_wrench: np.ndarray[Any, Any]
    samples: np.ndarray[Any, Any]
    loads_since: float | None = None
    slipped: dict[str, SlippedGrasp] = {}
