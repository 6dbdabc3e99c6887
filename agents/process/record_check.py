"""Verification of forwarded records about robots.

In the secure profile only records that the robot has signed itself are accepted. In both profiles records whose
incarnation is far in the future are refused: a robot replaces a wrong record about itself by one with a larger
incarnation, which must always be possible.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

from msgspec import structs

from coheft.consensus.gossip import is_newer
from coheft.wire.messages.limits import PER_MESSAGE
from coheft.wire.messages.structs import LinkState
from coheft.wire.transport.security import Credentials

if TYPE_CHECKING:  # needs an optional package
    from coheft.wire.transport.signatures import Signatures

_YEAR = 365 * 86_400 * 10**9
CLOCKS = 60 * _YEAR
"""An incarnation is the time of a robot's start. No host's clock is further ahead of another's than this [ns]; a host
without a clock starts in 1970. A robot can replace any accepted incarnation, because its clock advances."""


class RecordCheck:
    """Checks the records in the messages of one agent's neighbours; each record is checked once.

    Without signatures the profile is open; ``clock`` returns the time [ns since 1970].
    """

    def __init__(
        self, name: str, signatures: Signatures | None = None, clock: Callable[[], int] = time.time_ns
    ) -> None:
        self._name = name
        self.signatures = signatures
        self._clock = clock
        self._signed: dict[str, LinkState] = {}
        # Every message has the same one, until it changes.
        self._sign = None if signatures is None else lru_cache(maxsize=1)(signatures.signed)

    def believed(self, records: Sequence[LinkState], tell: Callable[[str], None]) -> list[LinkState]:
        """Return the records of a message that can be trusted.

        ``tell`` is called with what is wrong with the first record that cannot be trusted; the rest is ignored, so that
        no message costs more than one failed check. Records of this robot itself are returned without signature, to be
        compared with its own.
        """
        believed: list[LinkState] = []
        for record in records[:PER_MESSAGE]:
            known = self._signed.get(record.robot)
            if record != known:
                if known is not None and not is_newer(record, known):
                    continue  # an old record
                problem = self._problem(record)
                if problem is not None:
                    tell(f"its record of {record.robot!r} cannot be trusted: {problem}")
                    break
            is_own = record.robot == self._name
            believed.append(structs.replace(record, signature=b"", certificate=b"") if is_own else record)
        return believed

    def _problem(self, record: LinkState) -> str | None:
        ahead = record.incarnation - self._clock()
        if ahead > CLOCKS:
            return f"it claims a start {ahead / _YEAR:.3g} years in the future; if a host's clock is wrong, set it"
        if self.signatures is None:
            return None
        problem = self.signatures.problem(record)
        if problem is None:
            self._signed[record.robot] = record
        return problem

    def signed(self, records: list[LinkState]) -> list[LinkState]:
        """Return records to send; in the secure profile this robot's own one is signed."""
        if self._sign is None:
            return records
        return [self._sign(record) if record.robot == self._name else record for record in records]


def open_record_check(name: str, run: str, credentials: Credentials | None) -> RecordCheck:
    """Make the record check for an agent's credentials, or for the open profile if there are none.

    Raises:
        CoheftError: The credentials cannot be used.
        MissingPackageError: The secure profile's package is not installed.
    """
    if credentials is None:
        return RecordCheck(name)
    from coheft.wire.transport.signatures import Signatures

    return RecordCheck(name, Signatures(run, credentials))
