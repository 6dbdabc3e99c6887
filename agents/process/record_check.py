"""Verification of forwarded records about robots.

In the secure profile only what a robot has signed itself. In both profiles none that claims to begin in the far future:
a robot that is lied about outbids the lie by one, and must always be able to.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from msgspec import structs

from coheft.consensus.gossip import is_newer
from coheft.wire.messages.size import PER_MESSAGE
from coheft.wire.messages.structs import LinkState
from coheft.wire.transport.security import Credentials

if TYPE_CHECKING:  # it takes an optional package
    from coheft.wire.transport.signatures import Signatures

_YEAR = 365 * 86_400 * 10**9
CLOCKS = 60 * _YEAR
"""A robot's number is the time of its start: no other host's clock is further ahead [ns]. A host without a clock of its
own begins in 1970. What a liar claims at most, the robot has outbid as soon as the clock has gone on."""


class RecordCheck:
    """What one agent believes of the records in its neighbours' messages; each is looked at once.

    Args:
        name: The agent's own.
        signatures: In the secure profile, how records are signed and checked; None: the open profile.
        clock: Tells the time [ns since 1970].
    """

    def __init__(
        self, name: str, signatures: Signatures | None = None, clock: Callable[[], int] = time.time_ns
    ) -> None:
        self._name = name
        self._signatures = signatures
        self._clock = clock
        self._signed: dict[str, LinkState] = {}
        self._own, self._own_signed = LinkState("", 0, ()), LinkState("", 0, ())

    def believed(self, records: Sequence[LinkState], tell: Callable[[str], None]) -> list[LinkState]:
        """The records of a message that can be trusted.

        The first one that cannot is told, and nothing after it is looked at: no message costs more than one check in
        vain. What is said of this robot itself comes without its signature, as it compares it with what it knows.

        Args:
            records: As they came.
            tell: Takes what is wrong, in words.
        """
        believed: list[LinkState] = []
        for record in records[:PER_MESSAGE]:
            known = self._signed.get(record.robot)
            if record != known:
                if known is not None and not is_newer(record, known):
                    continue  # it comes late: no robot needs it
                problem = self._problem(record)
                if problem is not None:
                    tell(f"what it hands on about {record.robot!r} cannot be believed: {problem}")
                    break
            believed.append(_bare(record) if record.robot == self._name else record)
        return believed

    def _problem(self, record: LinkState) -> str | None:
        ahead = record.incarnation - self._clock()
        if ahead > CLOCKS:
            return f"it would have started in {ahead / _YEAR:.3g} years; if a host's clock is wrong, set it"
        if self._signatures is None:
            return None
        problem = self._signatures.problem(record)
        if problem is None:
            self._signed[record.robot] = record
        return problem

    def signed(self, records: list[LinkState]) -> list[LinkState]:
        """What this robot tells, with its own record signed in the secure profile."""
        if self._signatures is None:
            return records
        return [self._with_signature(record) if record.robot == self._name else record for record in records]

    def _with_signature(self, record: LinkState) -> LinkState:
        if record != self._own:
            assert self._signatures is not None
            self._own, self._own_signed = record, self._signatures.signed(record)
        return self._own_signed


def open_record_check(name: str, run: str, credentials: Credentials | None) -> RecordCheck:
    """For an agent's own credentials, or for the open profile if there are none.

    Args:
        name: The agent's own.
        run: Prefix of all keys of the run.
        credentials: The robot's own.

    Raises:
        CoheftError: They cannot be used.
        MissingPackageError: The secure profile's package is not installed.
    """
    if credentials is None:
        return RecordCheck(name)
    from coheft.wire.transport.signatures import Signatures

    return RecordCheck(name, Signatures(run, credentials))


def _bare(record: LinkState) -> LinkState:
    return structs.replace(record, signature=b"", certificate=b"")
