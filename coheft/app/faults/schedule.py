"""Faults of one simulated run, with their times. Equal schedules give equal runs, bit for bit."""

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from coheft.errors import ScenarioError
from coheft.estimation.measurement import Positive
from coheft.wire.former_names import as_present
from coheft.wire.scenario.file import complete_scenario
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import NotNegative, Seed

Probability = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=1, le=100_000)]
Sensor = Literal["gyro", "velocity", "acceleration", "force", "torque"]
SensorFailure = Literal["nan", "frozen", "outliers", "saturation", "offset"]
LieKind = Literal["scaled", "offset", "garbage"]
ReplaySource = Literal["had before", "former incarnation", "other run"]

ALL_ROBOTS = "*"
"""Sender or receiver of a link fault that concerns all robots."""


class Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """A fault from ``start`` to ``end`` [s].

    It draws from a ``seed`` of its own, so that removing a fault does not change the others.
    """

    start: NotNegative
    end: NotNegative
    seed: Seed = 0

    @property
    def kind(self) -> str:
        """Name of the kind of fault in tables."""
        match self:
            case Corruption(sealed=True):
                return "corruption before the checksum"
            case Replay():
                return f"replay ({self.source})"
            case SensorFault():
                return f"sensor {self.how}"
            case Lie():
                return f"lie ({self.how})"
        return str(self.__struct_config__.tag)

    def is_active(self, time: float) -> bool:
        """Whether the fault is active at a time [s]."""
        return self.start <= time < self.end


# --- of the network --------------------------------------------------------------------------------------------------


class LinkFault(Fault, frozen=True, kw_only=True):
    """A fault of messages from ``sender`` to ``receiver``; ``*`` stands for every robot."""

    sender: str = ALL_ROBOTS
    receiver: str = ALL_ROBOTS

    def concerns(self, sender: str, receiver: str) -> bool:
        """Whether the fault concerns a link."""
        return self.sender in (ALL_ROBOTS, sender) and self.receiver in (ALL_ROBOTS, receiver)


class Delay(LinkFault, frozen=True, kw_only=True, tag="delay"):
    """Messages arrive later by a number of blocks."""

    blocks: Count


class Loss(LinkFault, frozen=True, kw_only=True, tag="loss"):
    """Messages are lost with a probability."""

    probability: Probability


class Duplication(LinkFault, frozen=True, kw_only=True, tag="duplication"):
    """Messages are delivered twice with a probability, the second time up to ``blocks`` blocks later."""

    probability: Probability
    blocks: Annotated[int, Meta(ge=0)]


class Reordering(LinkFault, frozen=True, kw_only=True, tag="reordering"):
    """Every message arrives later by a random number of blocks, up to ``blocks``."""

    blocks: Count


class Corruption(LinkFault, frozen=True, kw_only=True, tag="corruption"):
    """Bits of messages flip; if ``sealed``, before the checksum: a message that can be decoded is then delivered."""

    probability: Probability
    bits: Count
    sealed: bool = False


class Replay(LinkFault, frozen=True, kw_only=True, tag="replay"):
    """In each block a message is repeated with a probability.

    It is one that the receiver has had before, one from before the sender's last restart (if it did restart), or one of
    another run.
    """

    probability: Probability
    source: ReplaySource


class Malformed(LinkFault, frozen=True, kw_only=True, tag="malformed"):
    """In each block an invalid message arrives with a probability, in addition to the correct one."""

    probability: Probability


class Partition(Fault, frozen=True, kw_only=True, tag="partition"):
    """No message passes between the robots of a group and the others."""

    group: tuple[str, ...]


# --- of one agent ----------------------------------------------------------------------------------------------------


class RobotFault(Fault, frozen=True, kw_only=True):
    """A fault of one robot or its agent."""

    robot: str


class Crash(RobotFault, frozen=True, kw_only=True, tag="crash"):
    """The agent dies, and restarts with an empty memory. Its robot keeps holding the load, at its last reference."""


class Pause(RobotFault, frozen=True, kw_only=True, tag="pause"):
    """The agent is suspended; when it resumes, it receives all messages sent meanwhile, but not the measurements."""


class Release(RobotFault, frozen=True, kw_only=True, tag="release"):
    """The robot releases the load, and grasps it again at the end.

    The agent knows both ``notice`` blocks in advance; of several releases, the largest counts.
    """

    notice: Annotated[int, Meta(ge=0)] = 0


class ClockSkew(RobotFault, frozen=True, kw_only=True, tag="clock skew"):
    """The robot's measurements have block numbers that are too high: they are older by a number of samples."""

    samples: Count


class SensorFault(RobotFault, frozen=True, kw_only=True, tag="sensor"):
    """One of the robot's sensors fails.

    Attributes:
        how: NaN in some samples; a constant value; bursts of outliers; readings clipped at a limit; a constant error.
        size: Share of samples that are NaN, or outliers; limit as a multiple of the usual reading; constant error per
            axis as a multiple of the noise.
    """

    sensor: Sensor
    how: SensorFailure
    size: Positive


class Lie(RobotFault, frozen=True, kw_only=True, tag="lie"):
    """The agent sends wrong samples and sums to its neighbours.

    They are scaled by a factor, shifted by a multiple of their root mean square, or replaced by random ones.
    """

    how: LieKind
    size: Positive


OfNetwork = Delay | Loss | Duplication | Reordering | Corruption | Replay | Malformed | Partition
OfAgent = Crash | Pause | Release | ClockSkew | SensorFault | Lie
AnyFault = OfNetwork | OfAgent


class FaultSchedule(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A run and its faults, and the seed from which it was drawn."""

    seed: Seed
    scenario: Scenario
    faults: tuple[AnyFault, ...] = ()

    @property
    def last_fault_end(self) -> float:
        """End of the last fault [s]; 0 if there is none."""
        return max((fault.end for fault in self.faults), default=0.0)


def is_harmless(fault: AnyFault) -> bool:
    """Whether a run with the fault must be the same, bit for bit, as one in which its messages never arrive."""
    return isinstance(fault, Duplication | Replay | Malformed)


def write_schedule(schedule: FaultSchedule, path: Path) -> None:
    """Write a schedule as JSON."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(schedule), indent=2))


def read_schedule(path: Path) -> FaultSchedule:
    """Read a schedule, also one that version 345a219 wrote, or raise a ``ScenarioError``."""
    try:
        table = msgspec.json.decode(path.read_bytes())
        if isinstance(table, dict) and isinstance(table.get("scenario"), dict):
            table["scenario"] = as_present(table["scenario"], f"{path}: scenario")
        schedule = msgspec.convert(table, FaultSchedule)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise ScenarioError(f"{path}: not a fault schedule: {error}") from error
    scenario = complete_scenario(schedule.scenario, f"{path}: scenario", path.parent)
    for number, fault in enumerate(schedule.faults):
        place = f"{path}: key 'faults[{number}]"
        _check_fault(fault, scenario.robot_names, place)
        if fault.start >= scenario.duration:
            raise ScenarioError(
                f"{place}.start': found {fault.start:g} s, expected a time before the end of the run, "
                f"'scenario.duration' = {scenario.duration:g} s"
            )
    return msgspec.structs.replace(schedule, scenario=scenario)


def _check_fault(fault: AnyFault, robots: tuple[str, ...], place: str) -> None:
    """Check that a fault begins and names robots that exist, which types do not express."""
    if fault.start >= fault.end:
        raise ScenarioError(
            f"{place}.end': found {fault.end:g} s, expected a time after 'start', which is {fault.start:g} s"
        )
    named: list[tuple[str, str]] = []
    match fault:
        case LinkFault():
            named = [("sender", fault.sender), ("receiver", fault.receiver)]
            robots = (*robots, ALL_ROBOTS)
        case Partition():
            named = [("group", name) for name in fault.group]
        case RobotFault():
            named = [("robot", fault.robot)]
    for key, name in named:
        if name not in robots:
            raise ScenarioError(f"{place}.{key}': found {name!r}, expected one of: {', '.join(robots)}")
