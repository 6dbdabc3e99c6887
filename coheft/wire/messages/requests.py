"""Requests of observers and of the operator to the server and the agents, with the answers, as msgspec structs."""

from enum import StrEnum

from msgspec.structs import force_setattr

from coheft.wire.former_names import keep_present, present
from coheft.wire.messages.structs import Message, sent_as
from coheft.wire.messages.truth import LoadState, Scene
from coheft.wire.scenario.network import LinkQuality

# --- to the server -----------------------------------------------------------------------------------------------


@sent_as(30)
class StatusRequest(Message, frozen=True):
    """Ask for the status of the run."""


@sent_as(31)
class InjectRequest(Message, frozen=True):
    """Add a load to the payload at the next block."""

    mass: float
    position: tuple[float, float, float]
    size: tuple[float, float, float] = (0.1, 0.1, 0.1)


@sent_as(32)
class RemoveRequest(Message, frozen=True):
    """Remove a load at the next block."""

    load: int


@sent_as(33)
class HoldRequest(Message, frozen=True):
    """Let a robot release the payload, or grasp it again, at the next block."""

    robot: str
    holding: bool


@sent_as(34)
class EstimatorRequest(Message, frozen=True):
    """Restart all robots with an empty memory and another estimator at the next block."""

    estimator: str

    def __post_init__(self) -> None:
        keep_present(self)


@sent_as(35)
class PauseRequest(Message, frozen=True):
    """Pause or resume the run."""

    paused: bool


@sent_as(36)
class StopRequest(Message, frozen=True):
    """End the run."""


@sent_as(37)
class ClockRequest(Message, frozen=True):
    """Set a robot's clock at the next block.

    Attributes:
        ahead: How far its clock is ahead [s], from 0 to 1: its samples were taken that long before their stamps, in
            addition to a delay that the scenario gives them.
    """

    robot: str
    ahead: float


Request = (
    StatusRequest
    | InjectRequest
    | RemoveRequest
    | HoldRequest
    | EstimatorRequest
    | PauseRequest
    | StopRequest
    | ClockRequest
)


class RunState(StrEnum):
    """What the server of a run does."""

    WAITING = "waiting"
    """It waits for all robots."""
    RUNNING = "running"
    PAUSED = "paused"
    FINISHED = "finished"
    """It simulates no further block, and has stopped the robots."""


@sent_as(40)
class Status(Message, frozen=True):
    """The server's answer to every request that it has carried out; also sent to all observers at the end of the run.

    Attributes:
        block: Number of blocks that have been simulated.
        real_time_factor: Simulated time divided by the wall time for which the clock ran.
        late_blocks: Number of late references over all robots. In spite of its name it does not count blocks.
        slots_free: Number of loads that can still be added.
        waiting_for: Robots without which the run cannot begin or continue, or that have not answered the newest block.
        estimator: Estimator that the robots use, at the latest from the next block on.
        estimators: Estimators that may be chosen.
        unsaved: Why the data file could not be written; empty if it was, or none was requested.
        failure: Why the run was aborted; empty if it was not.
    """

    scenario: str
    state: RunState
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


@sent_as(41)
class Refusal(Message, frozen=True):
    """The answer to a request that was refused, with the reason."""

    reason: str


# --- to an agent -------------------------------------------------------------------------------------------------


@sent_as(42)
class LinkRequest(Message, frozen=True):
    """Cut the link with a neighbour, or restore it.

    Only the agent that dials the other one can do so. To both it looks as if the network between them were cut.
    """

    neighbour: str
    cut: bool


@sent_as(43)
class CutLinks(Message, frozen=True):
    """An agent's answer to a request that it has carried out."""

    robot: str
    neighbours: list[str]


@sent_as(44)
class DisturbRequest(Message, frozen=True):
    """Let messages that this robot receives from a neighbour be lost or late from now on; the default restores them."""

    neighbour: str
    quality: LinkQuality


@sent_as(45)
class DisturbedLink(Message, frozen=True):
    """An agent's answer to a ``DisturbRequest`` that it carried out."""

    robot: str
    neighbour: str
    quality: LinkQuality
