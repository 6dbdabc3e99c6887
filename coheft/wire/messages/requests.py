"""What observers and the operator ask the server and the agents, and the answers, as msgspec structs."""

from __future__ import annotations

from typing import ClassVar, Literal

from msgspec.structs import force_setattr

from coheft.wire.former_names import keep_present, present
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.structs import LoadState, Message
from coheft.wire.scenario.network import LinkQuality

# --- to the server -----------------------------------------------------------------------------------------------


class StatusRequest(Message, frozen=True):
    """How is the run?"""

    code: ClassVar[int] = 30


class InjectRequest(Message, frozen=True):
    """Put a load onto the payload at the next block."""

    code: ClassVar[int] = 31

    mass: float
    position: tuple[float, float, float]
    size: tuple[float, float, float] = (0.1, 0.1, 0.1)


class RemoveRequest(Message, frozen=True):
    """Take a load away at the next block."""

    code: ClassVar[int] = 32

    load: int


class HoldRequest(Message, frozen=True):
    """Let a robot take its hand off the payload, or take hold of it again, at the next block."""

    code: ClassVar[int] = 33

    robot: str
    holding: bool


class EstimatorRequest(Message, frozen=True):
    """Let all robots forget what they know and begin anew with another estimator, at the next block."""

    code: ClassVar[int] = 34

    estimator: str

    def __post_init__(self) -> None:
        keep_present(self)


class PauseRequest(Message, frozen=True):
    """Stop the clock, or let it go on."""

    code: ClassVar[int] = 35

    paused: bool


class StopRequest(Message, frozen=True):
    """End the run."""

    code: ClassVar[int] = 36


Request = StatusRequest | InjectRequest | RemoveRequest | HoldRequest | EstimatorRequest | PauseRequest | StopRequest


class Status(Message, frozen=True):
    """The server's answer to every request that it carried out, and its last word to all observers.

    Attributes:
        scenario: Its name.
        state: Whether time runs.
        block: Number of blocks that have been simulated.
        time: Simulated so far [s].
        duration: Of the whole run [s].
        real_time_factor: Simulated time over the wall time for which the clock ran.
        late_blocks: References that came too late, over all robots: not blocks, whatever its name says.
        loads: On the payload.
        slots_free: How many more fit.
        waiting_for: Robots that it cannot begin or go on without, or that have not answered the newest block yet.
        estimator: Which one the robots use, from the next block on at the latest.
        estimators: Which ones may be chosen.
        scene: What does not change.
        unsaved: Why the data file that was asked for is not there; empty if it is, or none was asked for.
        failure: Why the run broke off; empty if it did not.
    """

    code: ClassVar[int] = 40

    scenario: str
    state: Literal["waiting", "running", "paused", "finished"]
    block: int
    time: float
    duration: float
    real_time_factor: float
    late_blocks: int
    loads: list[LoadState]
    slots_free: int
    waiting_for: list[str]
    estimator: str
    estimators: list[str]
    scene: Scene
    unsaved: str = ""
    failure: str = ""

    def __post_init__(self) -> None:
        keep_present(self)
        force_setattr(self, "estimators", [present(name) for name in self.estimators])


class Refusal(Message, frozen=True):
    """The answer to a request that was not carried out, and why."""

    code: ClassVar[int] = 41

    reason: str


# --- to an agent -------------------------------------------------------------------------------------------------


class LinkRequest(Message, frozen=True):
    """Hang up on a neighbour, and dial it no more until the opposite is asked.

    Only the one of the two that dials can do so; to both it is as if the wire between them were cut.

    Attributes:
        neighbour: The other end.
        cut: Whether to cut the link, or to mend it.
    """

    code: ClassVar[int] = 42

    neighbour: str
    cut: bool


class CutLinks(Message, frozen=True):
    """An agent's answer to a request that it carried out.

    Attributes:
        robot: Who answers.
        neighbours: On whom it has hung up.
    """

    code: ClassVar[int] = 43

    robot: str
    neighbours: list[str]


class DisturbRequest(Message, frozen=True):
    """Let messages that this robot receives from a neighbour be lost or late from now on.

    Attributes:
        neighbour: The sender of these messages.
        quality: Their loss and delay; the default restores the link.
    """

    code: ClassVar[int] = 44

    neighbour: str
    quality: LinkQuality


class DisturbedLink(Message, frozen=True):
    """An agent's answer to a ``DisturbRequest`` that it carried out.

    Attributes:
        robot: The agent's robot.
        neighbour: As in the request.
        quality: The same.
    """

    code: ClassVar[int] = 45

    robot: str
    neighbour: str
    quality: LinkQuality
