"""A link that is dialled anew, over real loopback links."""

from __future__ import annotations

import secrets
import threading
import time
from contextlib import closing
from pathlib import Path

from coheft.wire.messages.structs import Hello, Message
from coheft.wire.transport.dialled import DialledLink
from coheft.wire.transport.inbox import Inbox, Presence, Received
from coheft.wire.transport.sessions import Keys, Sender, open_session
from tests.ports import free_port
from tests.waiting import next_event, wait_until


def heard(inbox: Inbox) -> list[Message]:
    """What was said of late."""
    found = []
    while (event := inbox.receive(0.0)) is not None:
        if isinstance(event, Received):
            found.append(event.message)
    return found


def test_a_link_that_is_begun_anew_carries_both_ways_and_leaves_nothing_behind():
    endpoint, keys = f"tcp/127.0.0.1:{free_port()}", Keys(f"test-{secrets.token_hex(4)}")
    near_inbox, far_inbox = Inbox(), Inbox()
    from_far = Sender(None, keys.agent("far", "hello"), may_drop=False)

    def listen(session):
        far_inbox.announce(session, keys.agent("far", "alive"))
        far_inbox.watch_presence(session, "near", keys.agent("near", "alive"))
        far_inbox.listen(session, "near", {keys.agent("near", "hello"): Hello})

    with (
        open_session(listen=[endpoint]) as near,
        closing(DialledLink(endpoint, None, far_inbox, listen, [from_far])) as link,
    ):
        near_inbox.announce(near, keys.agent("near", "alive"))
        near_inbox.watch_presence(near, "far", keys.agent("far", "alive"))
        near_inbox.listen(near, "far", {keys.agent("far", "hello"): Hello})
        from_near = Sender(near, keys.agent("near", "hello"), may_drop=False)

        def carries() -> bool:
            from_far.send(Hello(sender="far", heard=[]))
            from_near.send(Hello(sender="near", heard=[]))
            time.sleep(0.01)
            return bool(heard(near_inbox)) and bool(heard(far_inbox))

        wait_until(carries)
        before = threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))
        sessions = {link.session}
        for _ in range(10):
            link.renew()
            sessions.add(link.session)
            wait_until(carries)
        assert len(sessions) == 11
        wait_until(lambda: threading.active_count() <= before[0])
        wait_until(lambda: len(list(Path("/proc/self/fd").iterdir())) <= before[1])

        last, arrived = Hello(sender="near", heard=["last"]), list[Message]()
        from_near.send(last)

        def has_arrived() -> bool:
            arrived.extend(heard(far_inbox))  # what was sent before may still come
            return last in arrived

        wait_until(has_arrived)
        time.sleep(0.1)
        arrived.extend(heard(far_inbox))
        assert arrived.count(last) == 1, "only the present session hears it"


def test_news_of_a_link_tell_of_which_session_they_are():
    endpoint, keys = f"tcp/127.0.0.1:{free_port()}", Keys(f"test-{secrets.token_hex(4)}")
    inbox, ours = Inbox(), Inbox()

    def listen(session):
        inbox.watch_presence(session, "near", keys.agent("near", "alive"))

    with open_session(listen=[endpoint]) as near, closing(DialledLink(endpoint, None, inbox, listen)) as link:
        ours.announce(near, keys.agent("near", "alive"))
        first = next_event(inbox)
        assert isinstance(first, Presence)
        assert (first.is_here, first.session) == (True, link.session)
        link.renew()
        second = next_event(inbox)
        assert isinstance(second, Presence)
        assert (second.is_here, second.session) == (True, link.session)
        assert first.session != second.session
