"""A link that we dial, with a session of its own, so that it can be begun anew without touching any other.

When the wire between two hosts is cut, Zenoh closes what is left of the link at one end, and that can take until the
operating system has given up sending: seconds to minutes. Whoever dials in meanwhile with the identity of the old link
is turned away, or taken for one more wire of it and never told who listens to what: one direction stays mute, for good.
A new session has a new identity, and none of these troubles.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from threading import Thread

import zenoh

from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.transport.inbox import Inbox
from coheft.wire.transport.security import Guard
from coheft.wire.transport.sessions import Sender, open_session, session_id


class DialledLink:
    """A link with the one who listens at an endpoint.

    Args:
        endpoint: Where to dial.
        guard: Who may be there, and say what.
        inbox: What hears.
        listen: Lets the inbox hear a new session.
        senders: What speaks.
        largest: Messages that are larger are dropped [B].

    Attributes:
        session: Identity of the present session; empty after hanging up.

    Raises:
        LinkError: The endpoint is malformed.
    """

    session: str

    def __init__(
        self,
        endpoint: str,
        guard: Guard | None,
        inbox: Inbox,
        listen: Callable[[zenoh.Session], None],
        *senders: Sender,
        largest: int = LEAST_LIMIT,
    ) -> None:
        self._endpoint = endpoint
        self._guard = guard
        self._inbox = inbox
        self._listen = listen
        self._senders = senders
        self._largest = largest
        self._dial()

    def _dial(self) -> None:
        with ExitStack() as stack:
            self._session = stack.enter_context(
                open_session(connect=[self._endpoint], guard=self._guard, largest=self._largest)
            )
            self._listen(self._session)
            for sender in self._senders:
                sender.attach(self._session)
            self._open = stack.pop_all()
        self.session = session_id(self._session)

    def hang_up(self) -> None:
        """Hear and say nothing more, until the link is renewed.

        The session is closed in the background, because that takes seconds when no one is at the other end.
        """
        if not self.session:
            return
        self.session = ""
        self._inbox.forget(self._session)
        for sender in self._senders:
            sender.detach(self._session)
        Thread(target=self._open.close, daemon=True).start()

    def renew(self) -> None:
        """Dial anew, with a new identity."""
        self.hang_up()
        self._dial()

    def close(self) -> None:
        """End the link, and wait until it has ended."""
        self._open.close()
