"""Wrapper of a user's estimator: either its return values are correct, or the agent ends with an error.

The author of an estimator learns of a mistake where it was made, and not from neighbours that refuse messages.
Restarting the agent would not help.
"""

from collections.abc import Callable, Mapping
from typing import TypeVar

from msgspec.structs import replace

from coheft.agents.estimator import Belief, Channels, Estimator
from coheft.agents.inbox import is_possible
from coheft.agents.plugins.returns import plain_answer, plain_belief, plain_channels, plain_texts
from coheft.consensus.gossip import Gossip
from coheft.errors import MessageError, PluginError, one_line
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.scenario.plugins import told

T = TypeVar("T")


class OwnEstimator:
    """A user's estimator, which may send arrays of ``largest_arrays`` [B] in one message. See
    ``coheft.agents.estimator.Estimator``; methods raise ``PluginError`` if the user's fail.
    """

    def __init__(self, own: Estimator, config: AgentConfig, gossip: Gossip, largest_arrays: int) -> None:
        self._own = own
        self._config = config
        self._gossip = gossip
        self._largest_arrays = largest_arrays
        self._index = -1

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """See ``Estimator.step``."""
        self._index = index
        return self._call("step", self._checked_step, index, own, inbox)

    def fits(self, channels: Channels) -> bool:
        """See ``Estimator.fits``."""
        return self._call("fits", plain_answer, channels)

    def belief(self) -> Belief:
        """See ``Estimator.belief``."""
        return self._call("belief", lambda found: plain_belief(found, self._index, self._config.neighbours))

    def doubts(self) -> tuple[str, ...]:
        """See ``Estimator.doubts``."""
        return self._call("doubts", plain_texts)

    def _checked_step(self, returned: object) -> dict[str, Array]:
        """Check what a step sends to neighbours: the returned arrays, and this robot's record in ``Gossip``."""
        channels = plain_channels(returned, self._largest_arrays)
        # Other robots can influence these two numbers, so they are not checked.
        record = replace(self._gossip.own, incarnation=0, sequence=0)
        if not is_possible(record):
            raise MessageError(
                f"it made Gossip announce an impossible record, expected what LinkState allows: {record}"
            )
        return channels

    def _call(self, method: str, check: Callable[[object], T], *arguments: object) -> T:
        """Call a method and return its checked result, or raise a ``PluginError``."""
        bound = getattr(self._own, method)
        try:
            returned = bound(*arguments)
        except Exception as error:  # a user's code may raise anything
            raise PluginError(f"{self._what}: {method} raised {told(error, type(self._own).__module__)}") from error
        try:
            return check(returned)
        except Exception as error:  # a user's object may raise anything when it is looked at
            why = str(error) if isinstance(error, MessageError) else f"{type(error).__name__}: {one_line(str(error))}"
            raise PluginError(
                f"{self._what}: {method}{_place(bound)} returned an unusable value: {why}. See docs/own.md"
            ) from error

    @property
    def _what(self) -> str:
        """Name of the estimator and the robot, with the present block."""
        config, index = self._config, self._index
        when = f" at block {index} ({config.start_of(index):.2f} s)" if index >= 0 else ""
        return f"the estimator {config.estimator!r} of {config.name}{when}"


def _place(bound: object) -> str:
    """Return the file and line of a method, if it is written in Python."""
    code = getattr(bound, "__code__", None)
    return "" if code is None else f" ({code.co_filename}, line {code.co_firstlineno})"
