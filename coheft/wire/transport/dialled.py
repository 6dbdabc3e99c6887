"""A link that this process dials, with a session of its own, so that it can be renewed without affecting other links.

When the network between two hosts is cut, Zenoh closes the rest of the link at one end, which can take until the
operating system has given up sending: seconds to minutes. Whoever dials in meanwhile with the identity of the old link
is rejected, or treated as an additional connection of it and not informed about subscriptions, so that one direction
never works again. A new session has a new identity and avoids both.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from threading import Thread

import zenoh

from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.transport.inbox import Inbox
from coheft.wire.transport.security import Guard
from coheft.wire.transport.sessions import Sender, open_session, session_id


@dataclass(eq=False)
class DialledLink:
    """A link with the process that listens at an endpoint.

    Attributes:
        listen: Subscribes the inbox to a new session.
        senders: Senders to be attached to each session.
        largest: Larger messages are dropped [B].
        session: Identity of the present session; empty after ``hang_up``.

    Raises:
        LinkError: The endpoint is malformed.
    """

    endpoint: str
    guard: Guard | None
    inbox: Inbox
    listen: Callable[[zenoh.Session], None]
    senders: Sequence[Sender] = ()
    largest: int = LEAST_LIMIT
    session: str = field(init=False)

    def __post_init__(self) -> None:
        self._dial()

    def _dial(self) -> None:
        with ExitStack() as stack:
            self._session = stack.enter_context(
                open_session(connect=[self.endpoint], guard=self.guard, largest=self.largest)
            )
            self.listen(self._session)
            for sender in self.senders:
                sender.attach(self._session)
            self._open = stack.pop_all()
        self.session = session_id(self._session)

    def hang_up(self) -> None:
        """Stop receiving and sending, until the link is renewed.

        The session is closed in the background, because that takes seconds if the other end is dead.
        """
        if not self.session:
            return
        self.session = ""
        self.inbox.forget(self._session)
        for sender in self.senders:
            sender.detach(self._session)
        Thread(target=self._open.close, daemon=True).start()

    def renew(self) -> None:
        """Dial again, with a new identity."""
        self.hang_up()
        self._dial()

    def close(self) -> None:
        """Close the link, and wait until it is closed."""
        self._open.close()
