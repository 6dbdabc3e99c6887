"""The server's end of a robot's link: the measurements that were sent, and the references that were received."""

from collections.abc import Callable

import zenoh
from msgspec import structs

from coheft.errors import MessageError
from coheft.wire.messages.codec import check_field, is_finite
from coheft.wire.messages.frame import DOUBLE
from coheft.wire.messages.structs import Measurements, Message, Ready, Reference, Stop
from coheft.wire.transport.inbox import Inbox
from coheft.wire.transport.sessions import Keys, Sender

_MOTION_SIZE, _WRENCH_SHAPE = 12, (6,)


def not_finite(reference: Reference) -> str | None:
    """Say that a reference is not finite; None if it is."""
    if is_finite(reference.motion) and is_finite(reference.wrench):
        return None
    return f"the reference of block {reference.block} is not finite"


class RobotLink:
    """One robot's session, and the state of the communication with it.

    Args:
        world: Number of the simulated world; a new number makes agents restart.
        excess: Describes why an arm cannot follow a reference, which may not be finite; returns None if it can.

    Attributes:
        is_ready: Whether it asks for measurements, and can receive them.
        is_linked: Whether a process is at the other end.
        answered: The last block of measurements that it has answered or will not answer any more, -1 if none.
        joined: The first block in which it took part.
        is_refused: Whether its latest reference cannot be followed.
    """

    def __init__(
        self,
        name: str,
        session: zenoh.Session,
        inbox: Inbox,
        keys: Keys,
        *,
        world: int,
        lag: int,
        block: int,
        excess: Callable[[Reference], str | None] = not_finite,
    ) -> None:
        self.name = name
        self.is_ready = False
        self.is_linked = False
        self.missing: list[str] = []
        self.answered = -1
        self.joined = 0
        self.is_refused = False
        self._attempt = -1
        self._world = world
        self._lag = lag
        self._motion_shape = (block, _MOTION_SIZE)
        self._excess = excess
        self._sent = -1
        # By block; None for references that no arm can follow.
        self._references: dict[int, Reference | None] = {}
        self._measurements = Sender(session, keys.robot(name, "measurements"), may_drop=False)
        self._stop = Sender(session, keys.robot(name, "stop"), may_drop=False)
        inbox.listen(session, name, {keys.robot(name, "ready"): Ready, keys.robot(name, "reference"): Reference})

    @property
    def is_settled(self) -> bool:
        """Whether the robot is ready and linked with all its neighbours."""
        return self.is_ready and not self.missing

    @property
    def owes_answer(self) -> bool:
        """Whether it has received measurements that it has not answered."""
        return self.answered < self._sent

    def note_link(self, is_linked: bool) -> None:
        """Note whether a process is at the other end."""
        self.is_linked = is_linked
        if not self.is_linked:
            self.is_ready = False
            self.answered = self._sent

    def take(self, message: Message) -> None:
        """Process the robot's message; raise ``MessageError`` if it is not valid here and now."""
        match message:
            case Ready():
                check_field("robot", message.robot, self.name)
                if message.attempt != self._attempt:  # it asks anew, and answers no earlier measurements
                    self._attempt, self.answered = message.attempt, self._sent
                self.missing = message.missing
                self.is_ready = self._measurements.has_listener
            case Reference():
                self._check(message)
                self.answered = message.answers
                self._keep(message)

    def join(self, block: int) -> None:
        """Let the robot take part from a block on."""
        self.joined = block
        self.answered = block - 1

    def _check(self, reference: Reference) -> None:
        check_field("robot", reference.robot, self.name)
        if not self.owes_answer:
            raise MessageError(f"answers is {reference.answers} but block {self._sent} has already been answered")
        if not self.answered < reference.answers <= self._sent:
            raise MessageError(
                f"answers is {reference.answers} but expected a block from {self.answered + 1} to {self._sent}"
            )
        check_field("block", reference.block, reference.answers + self._lag)
        motion, wrench = reference.motion, reference.wrench
        found = motion.shape, wrench.shape, motion.dtype, wrench.dtype
        if found != (self._motion_shape, _WRENCH_SHAPE, DOUBLE, DOUBLE):
            for name, array, shape in (("motion", motion, self._motion_shape), ("wrench", wrench, _WRENCH_SHAPE)):
                check_field(f"{name}.shape", array.shape, shape)
                check_field(f"{name}.dtype", array.dtype.name, DOUBLE.name)

    def _keep(self, reference: Reference) -> None:
        """Keep a reference for its block. One that no arm can follow counts as an answer, but is not used.

        The first of a series of these raises a ``MessageError``.
        """
        excess = self._excess(reference)
        if excess is not None:
            excess = not_finite(reference) or excess
        self._references[reference.block] = reference if excess is None else None
        was_refused, self.is_refused = self.is_refused, excess is not None
        if excess is not None and not was_refused:
            raise MessageError(f"{excess}: its arm holds still until it gets a reference that it can follow")

    def is_late(self, block: int) -> bool:
        """Whether the robot's reference of a block is late."""
        return self.is_ready and block >= self.joined + self._lag and block not in self._references

    def take_reference(self, block: int) -> Reference | None:
        """Return the robot's reference of a block, None if there is no usable one; earlier ones may be deleted."""
        if len(self._references) > 2 * self._lag:
            self._references = {index: other for index, other in self._references.items() if index >= block}
        return self._references.get(block)

    def send_measurements(self, measurements: Measurements, estimator: str = "") -> None:
        """Send the robot its measurements; ``estimator`` is the one to use, if not that of its configuration."""
        self._sent = measurements.block
        self._measurements.send(
            structs.replace(measurements, world=self._world, attempt=self._attempt, estimator=estimator)
        )

    def send_stop(self, reason: str) -> None:
        """Tell the robot that the run is over."""
        self._stop.send(Stop(reason=reason))
