"""What goes wrong in one simulated run, and when. A schedule says all: equal schedules give equal runs, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from coheft.errors import ScenarioError
from coheft.estimation.measurement import Positive
from coheft.wire.scenario.file import complete_scenario
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import NotNegative, Seed

Probability = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=1)]
Sensor = Literal["gyro", "velocity", "acceleration", "force", "torque"]
SensorFailure = Literal["nan", "frozen", "outliers", "saturation", "offset"]
LieKind = Literal["scaled", "offset", "garbage"]

ALL_ROBOTS = "*"
"""As a sender or receiver of a link fault."""


class Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """Base of all faults.

    Attributes:
        start: Time from which on it holds [s].
        end: Time from which on it does not hold any more [s].
        seed: Of all that is random in it; its own, so that faults can be taken out without changing the others.
    """

    start: NotNegative
    end: NotNegative
    seed: Seed = 0

    @property
    def kind(self) -> str:
        """Name of its kind, in tables."""
        return str(self.__struct_config__.tag)

    def is_active(self, time: float) -> bool:
        """Whether it holds at that time [s]."""
        return self.start <= time < self.end


# --- of the network --------------------------------------------------------------------------------------------------


class LinkFault(Fault, frozen=True, kw_only=True):
    """A fault of messages on their way, from ``sender`` to ``receiver``; ``*`` is every robot."""

    sender: str = ALL_ROBOTS
    receiver: str = ALL_ROBOTS

    def concerns(self, sender: str, receiver: str) -> bool:
        """Whether this link is meant."""
        return self.sender in (ALL_ROBOTS, sender) and self.receiver in (ALL_ROBOTS, receiver)


class Delay(LinkFault, frozen=True, kw_only=True, tag="delay"):
    """Messages take so many blocks longer."""

    blocks: Count


class Loss(LinkFault, frozen=True, kw_only=True, tag="loss"):
    """Messages get lost with this probability."""

    probability: Probability


class Duplication(LinkFault, frozen=True, kw_only=True, tag="duplication"):
    """Messages come twice with this probability, the second time up to so many blocks later."""

    probability: Probability
    blocks: Annotated[int, Meta(ge=0)]


class Reordering(LinkFault, frozen=True, kw_only=True, tag="reordering"):
    """Every message takes longer by a random number of blocks, up to this one."""

    blocks: Count


class Corruption(LinkFault, frozen=True, kw_only=True, tag="corruption"):
    """Bits of messages flip.

    Attributes:
        probability: Of a message to be hit.
        bits: That flip in it.
        sealed: Whether they flip before the checksum is made: what still is a message then arrives.
    """

    probability: Probability
    bits: Count
    sealed: bool = False

    @property
    def kind(self) -> str:
        """See ``Fault.kind``."""
        return "corruption before the checksum" if self.sealed else "corruption"


class Replay(LinkFault, frozen=True, kw_only=True, tag="replay"):
    """Per block, with this probability, a message comes again.

    Attributes:
        probability: Of that.
        source: One that the receiver has had before, one that it had from the sender before the sender's last restart
            (if it did restart), or one of another run.
    """

    probability: Probability
    source: Literal["had before", "former incarnation", "other run"]

    @property
    def kind(self) -> str:
        """See ``Fault.kind``."""
        return f"replay ({self.source})"


class Malformed(LinkFault, frozen=True, kw_only=True, tag="malformed"):
    """Per block, with this probability, a message comes besides the true one that no robot can have meant so."""

    probability: Probability


class Partition(Fault, frozen=True, kw_only=True, tag="partition"):
    """No message passes between these robots and the others."""

    group: tuple[str, ...]

    def separates(self, sender: str, receiver: str) -> bool:
        """Whether it cuts this link."""
        return (sender in self.group) != (receiver in self.group)


# --- of one agent ----------------------------------------------------------------------------------------------------


class RobotFault(Fault, frozen=True, kw_only=True):
    """A fault of one robot or its agent."""

    robot: str


class Crash(RobotFault, frozen=True, kw_only=True, tag="crash"):
    """The agent dies, and comes back with an empty memory. Its robot holds the load on, at its last reference."""


class Pause(RobotFault, frozen=True, kw_only=True, tag="pause"):
    """The agent stands still; when it goes on it finds all messages of the meantime, but not the measurements."""


class Release(RobotFault, frozen=True, kw_only=True, tag="release"):
    """The robot lets go of the load, and takes hold again at the end.

    Attributes:
        notice: How many blocks ahead its agent is told, of both; if it lets go several times, the largest counts.
    """

    notice: Annotated[int, Meta(ge=0)] = 0


class ClockSkew(RobotFault, frozen=True, kw_only=True, tag="clock skew"):
    """The robot's measurements bear numbers that are too high: they are this many samples older than they say."""

    samples: Count


class SensorFault(RobotFault, frozen=True, kw_only=True, tag="sensor"):
    """One of the robot's sensors fails.

    Attributes:
        sensor: Which.
        how: NaN in some samples; the same value again and again; bursts of outliers; readings cut off at a limit;
            a constant error.
        size: Share of samples that are NaN, or of outliers; limit as a multiple of what the sensor usually reads; size
            of the constant error per axis as a multiple of the noise.
    """

    sensor: Sensor
    how: SensorFailure
    size: Positive

    @property
    def kind(self) -> str:
        """See ``Fault.kind``."""
        return f"sensor {self.how}"


class Lie(RobotFault, frozen=True, kw_only=True, tag="lie"):
    """What the agent tells its neighbours of its samples and of sums is not what it knows.

    Attributes:
        how: All numbers multiplied, or shifted by a multiple of their root mean square, or replaced by random ones.
        size: Factor, or share of the root mean square.
    """

    how: LieKind
    size: Positive

    @property
    def kind(self) -> str:
        """See ``Fault.kind``."""
        return f"lie ({self.how})"


AnyFault = (
    Delay
    | Loss
    | Duplication
    | Reordering
    | Corruption
    | Replay
    | Malformed
    | Partition
    | Crash
    | Pause
    | Release
    | ClockSkew
    | SensorFault
    | Lie
)


class FaultSchedule(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A run and its faults.

    Attributes:
        seed: It was drawn from.
        scenario: What is simulated, load changes included.
        faults: What goes wrong besides.
    """

    seed: Seed
    scenario: Scenario
    faults: tuple[AnyFault, ...] = ()

    @property
    def last_fault_end(self) -> float:
        """When the last fault is over [s]; 0 if there is none."""
        return max((fault.end for fault in self.faults), default=0.0)


def is_harmless(fault: AnyFault) -> bool:
    """Whether a run with it must be the same, bit for bit, as one in which its messages never came."""
    return isinstance(fault, Duplication | Replay | Malformed)


def write_schedule(schedule: FaultSchedule, path: Path) -> None:
    """Write a schedule as JSON."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(schedule), indent=2))


def read_schedule(path: Path) -> FaultSchedule:
    """Read a schedule.

    Raises:
        ScenarioError: There is none, or it cannot be run.
    """
    try:
        schedule = msgspec.json.decode(path.read_bytes(), type=FaultSchedule)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise ScenarioError(f"{path}: not a fault schedule: {error}") from error
    scenario = complete_scenario(schedule.scenario, f"{path}: scenario", path.parent)
    for number, fault in enumerate(schedule.faults):
        _check_fault(fault, scenario.robot_names, f"{path}: key 'faults[{number}]")
    return msgspec.structs.replace(schedule, scenario=scenario)


def _check_fault(fault: AnyFault, robots: tuple[str, ...], place: str) -> None:
    """Check what the types cannot say.

    Raises:
        ScenarioError: It never begins, or is of somebody who is not there.
    """
    if fault.start >= fault.end:
        raise ScenarioError(
            f"{place}.end': found {fault.end:g} s, expected a time after 'start', which is {fault.start:g} s"
        )
    named: dict[str, tuple[str, ...]] = {}
    match fault:
        case LinkFault():
            named = {"sender": (fault.sender,), "receiver": (fault.receiver,)}
            robots = (*robots, ALL_ROBOTS)
        case Partition():
            named = {"group": fault.group}
        case RobotFault():
            named = {"robot": (fault.robot,)}
    for key, names in named.items():
        for name in names:
            if name not in robots:
                raise ScenarioError(f"{place}.{key}': found {name!r}, expected one of: {', '.join(robots)}")
