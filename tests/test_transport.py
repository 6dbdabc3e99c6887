"""Sessions, inboxes and senders, over real loopback links."""

from __future__ import annotations

import contextlib
import secrets
import threading
from collections.abc import Iterator

import numpy as np
import pytest
import zenoh

from coheft.errors import CoheftError, LinkError, MessageError
from coheft.wire.messages.codec import encode
from coheft.wire.messages.frame import PROTOCOL_VERSION
from coheft.wire.messages.requests import InjectRequest, Refusal, RunState, Status, StatusRequest
from coheft.wire.messages.structs import Hello, Measurements, Ready
from coheft.wire.messages.truth import Scene as SceneMessage
from coheft.wire.transport.backlog import keep_thread_state
from coheft.wire.transport.inbox import Inbox, Presence, Question, Received, Refused
from coheft.wire.transport.sessions import REFUSAL, Keys, Sender, ask, check_name, open_session
from tests.fuzz.any_message import of_version
from tests.ports import free_port
from tests.waiting import next_event, wait_until


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def keys() -> Keys:
    return Keys(f"test-{secrets.token_hex(4)}")


@pytest.fixture
def pair(endpoint: str) -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    with open_session(listen=[endpoint]) as near, open_session(connect=[endpoint]) as far:
        yield near, far


def test_messages_arrive_in_order_decoded_and_with_their_source(pair, keys):
    near, far = pair
    inbox = Inbox()
    inbox.listen(near, "r1", {keys.robot("r1", "ready"): Ready, keys.robot("r1", "measurements"): Measurements})
    ready = Sender(far, keys.robot("r1", "ready"), may_drop=False)
    measurements = Sender(far, keys.robot("r1", "measurements"), may_drop=False)
    wait_until(lambda: ready.has_listener and measurements.has_listener)
    samples = np.random.default_rng(0).normal(size=(10, 15))
    ready.send(Ready(robot="r1"))
    for block in range(200):
        measurements.send(Measurements(robot="r1", block=block, samples=samples))

    assert next_event(inbox) == Received("r1", Ready(robot="r1"))
    for block in range(200):
        event = next_event(inbox)
        assert isinstance(event, Received)
        assert isinstance(event.message, Measurements)
        assert event.message.block == block
        np.testing.assert_array_equal(event.message.samples, samples)


def test_what_is_not_the_expected_message_is_refused_and_the_next_one_arrives(pair, keys):
    near, far = pair
    inbox = Inbox()
    key = keys.agent("r2", "hello")
    inbox.listen(near, "r2", {key: Hello})
    sender = Sender(far, key, may_drop=False)
    wait_until(lambda: sender.has_listener)
    hello = Hello(sender="r2", heard=[])
    far.put(key, b"\xc1 no MessagePack")
    far.put(key, encode(Ready(robot="r2"), key))
    far.put(key, of_version(PROTOCOL_VERSION + 1, Hello(sender="r2", heard=[]), key))
    far.delete(key)
    far.put(keys.agent("r2", "gossip"), encode(hello, key))
    far.put(key, encode(hello, Keys("older-run").agent("r2", "hello")))
    sender.send(hello)

    texts = []
    for _ in range(6):
        event = next_event(inbox)
        assert isinstance(event, Refused)
        texts.append(str(event.error))
    assert "not a Hello" in texts[0]
    assert "not a Hello" in texts[1]
    assert f"version {PROTOCOL_VERSION + 1}" in texts[2]
    assert "not a Hello" in texts[3]
    assert "no message is expected under the key" in texts[4]
    assert "from another run" in texts[5]
    assert next_event(inbox) == Received("r2", hello)


def test_threads_that_call_back_keep_what_python_knows_of_them(pair, keys):
    """What is local to a thread goes with its Python state."""
    near, far = pair
    local, counts = threading.local(), []

    def count(_: zenoh.Sample) -> None:
        keep_thread_state()
        local.count = getattr(local, "count", 0) + 1
        counts.append(local.count)

    handler = zenoh.handlers.Callback(count, indirect=False)
    subscriber = near.declare_subscriber(keys.robot("r1", "ready"), handler)
    sender = Sender(far, keys.robot("r1", "ready"), may_drop=False)
    wait_until(lambda: sender.has_listener)
    for _ in range(100):
        sender.send(Ready(robot="r1"))
    wait_until(lambda: len(counts) == 100)
    assert max(counts) > 10
    subscriber.undeclare()


def test_no_process_hears_itself(pair, keys):
    near, far = pair
    inbox = Inbox()
    inbox.listen(near, "r1", {keys.robot("r1", "ready"): Ready})
    own = Sender(near, keys.robot("r1", "ready"), may_drop=False)
    other = Sender(far, keys.robot("r1", "ready"), may_drop=False)
    wait_until(lambda: other.has_listener)
    own.send(Ready(robot="own"))
    other.send(Ready(robot="other"))
    assert next_event(inbox) == Received("r1", Ready(robot="other"))


def test_receive_gives_up_after_its_timeout():
    inbox = Inbox()
    assert inbox.receive(0.0) is None
    assert inbox.receive(0.01) is None


def test_links_that_come_and_go_are_told(endpoint):
    inbox = Inbox()
    with open_session(listen=[endpoint]) as near:
        inbox.watch_links(near, "r1")
        with open_session(connect=[endpoint]):
            assert next_event(inbox) == Presence("r1", True)
        assert next_event(inbox) == Presence("r1", False)


def test_who_dials_first_is_linked_when_the_other_one_comes(endpoint, keys):
    with open_session(connect=[endpoint]) as far:
        sender = Sender(far, keys.agent("r1", "hello"), may_drop=False)
        assert not sender.has_listener
        with open_session(listen=[endpoint]) as near:
            inbox = Inbox()
            inbox.listen(near, "r1", {keys.agent("r1", "hello"): Hello})
            wait_until(lambda: sender.has_listener)


def test_questions_are_answered_or_refused(pair, keys):
    near, far = pair
    inbox = Inbox()
    inbox.serve(near, {keys.request("operator"): "operator"})
    status = Status(
        scenario="ring6",
        state=RunState.RUNNING, block=7, time=0.14, duration=35.0, real_time_factor=1.0, late_blocks=0,
        loads=[], slots_free=4, waiting_for=[], estimator="efficient", estimators=["efficient", "fan2017"],
        scene=SceneMessage(robots=["r1"], rotations=np.eye(3)[None], translations=np.zeros((1, 3)), neighbours={}),
    )  # fmt: skip

    def served() -> bool:
        with contextlib.suppress(LinkError):
            return isinstance(asking(far, keys.request("operator"), inbox, status, StatusRequest()), Status)
        return False

    wait_until(served)
    answer = asking(far, keys.request("operator"), inbox, status, StatusRequest())
    assert isinstance(answer, Status)
    assert answer.block == 7
    too_heavy = Refusal(reason="too heavy")
    request = InjectRequest(mass=9.0, position=(0, 0, 0))
    assert asking(far, keys.request("operator"), inbox, too_heavy, request) == too_heavy


def asking(
    session: zenoh.Session, key: str, inbox: Inbox, reply: Status | Refusal, request: StatusRequest | InjectRequest
) -> Status | Refusal:
    """Ask from a thread of its own while this one answers."""
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(ask, Status, session, key, request)
        while not answer.done():
            event = inbox.receive(0.02)
            if isinstance(event, Question):
                assert event.request == request
                event.answer(reply)
        return answer.result()


def test_a_malformed_question_is_refused_by_the_inbox(pair, keys):
    near, far = pair
    inbox = Inbox()
    inbox.serve(near, {keys.request("operator"): "operator"})
    querier = far.declare_querier(keys.request("operator"))
    wait_until(lambda: querier.matching_status.matching)
    replies = querier.get(payload=b"{}")
    assert isinstance(next_event(inbox), Refused)
    errors = [reply.err for reply in replies]
    assert len(errors) == 1
    assert errors[0] is not None
    assert b"not a " in errors[0].payload.to_bytes()


def test_an_answer_of_another_release_is_no_silence(pair, keys):
    near, far = pair
    key = keys.request("operator")
    other = of_version(PROTOCOL_VERSION + 1, Refusal(reason="no"), key)
    queryable = near.declare_queryable(key, lambda query: query.reply_err(other, encoding=REFUSAL), complete=True)
    querier = far.declare_querier(key)
    wait_until(lambda: querier.matching_status.matching)
    with pytest.raises(MessageError, match="run the same release of coheft on all hosts"):
        ask(Status, far, key, StatusRequest())
    queryable.undeclare()


@pytest.mark.parametrize("encoding", [zenoh.Encoding.ZENOH_BYTES, zenoh.Encoding.ZENOH_STRING])
def test_words_of_zenoh_itself_are_silence(pair, keys, encoding):
    near, far = pair
    key = keys.request("operator")
    late = b"Timeout"
    queryable = near.declare_queryable(key, lambda query: query.reply_err(late, encoding=encoding), complete=True)
    querier = far.declare_querier(key)
    wait_until(lambda: querier.matching_status.matching)
    with pytest.raises(LinkError, match="no answer"):
        ask(Status, far, key, StatusRequest())
    queryable.undeclare()


def test_a_question_that_nobody_answers_is_an_error(endpoint, keys):
    with open_session(connect=[endpoint]) as session, pytest.raises(LinkError, match="no answer"):
        ask(Status, session, keys.request("operator"), StatusRequest(), timeout=0.1)


def test_a_port_that_is_taken_is_an_error(endpoint):
    says = rf"^cannot listen at {endpoint}: (?!.*\.rs:).*in use"
    with open_session(listen=[endpoint]), pytest.raises(LinkError, match=says), open_session([endpoint]):
        pass


@pytest.mark.parametrize("name", ["", "a b", "..", "*", "r1/**", "r1/", "$*", "-r", "r1\n", "ü"])
def test_names_that_would_change_a_key_are_refused(name):
    with pytest.raises(CoheftError, match="cannot be a name"):
        check_name(name)
    with pytest.raises(CoheftError, match="cannot be a name"):
        Keys("run").robot(name, "ready")
    with pytest.raises(CoheftError, match="cannot be a name"):
        Keys(name)
