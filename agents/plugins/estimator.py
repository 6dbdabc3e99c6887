"""Wrapper of a user's estimator: either its return values are correct, or the agent ends and says what is wrong.

Somebody who writes an estimator learns of a mistake where it was made, with the place, and not from neighbours that
refuse messages. It is the program that is wrong, so a new start would not help.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

import msgspec
from msgspec.structs import replace

from coheft.agents.estimator import Belief, Channels, Estimator
from coheft.agents.inbox import is_possible
from coheft.agents.plugins.returns import plain_answer, plain_belief, plain_channels, plain_texts
from coheft.consensus.gossip import Gossip
from coheft.errors import MessageError, PluginError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import LinkState
from coheft.wire.scenario.plugins import told

T = TypeVar("T")


class OwnEstimator:
    """See ``coheft.agents.estimator.Estimator``; every method raises ``PluginError`` if the own one's fails.

    Args:
        own: The user's.
        config: It was made with.
        gossip: It was made with.
        largest_arrays: What it may send in one message [B].
    """

    def __init__(self, own: Estimator, config: AgentConfig, gossip: Gossip, largest_arrays: int) -> None:
        self._own = own
        self._config = config
        self._gossip = gossip
        self._largest_arrays = largest_arrays
        self._index = -1

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """One block."""
        self._index = index
        return self._call("step", self._told, index, own, inbox)

    def fits(self, channels: Channels) -> bool:
        """Whether what a neighbour sent can be read."""
        return self._call("fits", plain_answer, channels)

    def belief(self) -> Belief:
        """What is believed after the last step."""
        return self._call("belief", lambda found: plain_belief(found, self._index, self._config.neighbours))

    def doubts(self) -> tuple[str, ...]:
        """Why that may not be true any more."""
        return self._call("doubts", plain_texts)

    def _told(self, returned: object) -> dict[str, Array]:
        """What a step has told neighbours: by what it returned, and by ``Gossip``."""
        channels = plain_channels(returned, self._largest_arrays)
        # Whatever others may have said of this robot is in these two, and not the estimator's fault.
        record = replace(self._gossip.own, incarnation=0, sequence=0)
        try:
            can_be_told = is_possible(msgspec.convert(msgspec.to_builtins(record), LinkState))
        except (TypeError, msgspec.ValidationError):  # numbers of numpy, for instance
            can_be_told = False
        if not can_be_told:
            raise MessageError(
                f"what it has had Gossip announce is impossible, expected what LinkState allows: {record}"
            )
        return channels

    def _call(self, method: str, check: Callable[[object], T], *arguments: object) -> T:
        """What a method returns, checked.

        Raises:
            PluginError: It raises something, or returns what cannot be used.
        """
        bound = getattr(self._own, method)
        try:
            returned = bound(*arguments)
        except Exception as error:  # whatever somebody else's code raises
            raise PluginError(f"{self._what}: {method} raised {told(error, type(self._own).__module__)}") from error
        try:
            return check(returned)
        except MessageError as error:
            raise PluginError(
                f"{self._what}: {method}{_place(bound)} returned what cannot be used: {error}. See docs/own.md"
            ) from error

    @property
    def _what(self) -> str:
        """Which one, and when."""
        config, index = self._config, self._index
        when = f" at block {index} ({config.start_of(index):.2f} s)" if index >= 0 else ""
        return f"the estimator {config.estimator!r} of {config.name}{when}"


def _place(bound: object) -> str:
    """Where a method is written, if it is a usual one."""
    code = getattr(bound, "__code__", None)
    return "" if code is None else f" ({code.co_filename}, line {code.co_firstlineno})"
