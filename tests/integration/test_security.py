"""Attacks on guarded sessions. Each is also tried where it works, in the open profile or with the right certificate."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest
import zenoh

from coheft.wire.transport.inbox import Inbox, Presence, Refused
from coheft.wire.transport.planes import (
    guard_agent_for_observers,
    guard_neighbours,
    guard_observer,
    guard_server_for_observers,
    guard_server_for_robot,
)
from coheft.wire.transport.security import Credentials, Guard
from coheft.wire.transport.sessions import Keys, open_session
from tests.ports import free_port
from tests.waiting import next_event, wait_until

from .attacker import PUSHING, Busybody, Crossing, Profile, let_act, raw_session, tls_settings

OPEN = Profile(None)
KEYS = Keys(f"test-{secrets.token_hex(4)}")
NAMES = ("r1", "r2", "r3", "r4", "server", "observer", "operator")
EVERYTHING = (
    *(KEYS.agent(name, topic) for name in ("r1", "r2", "r3") for topic in ("block", "hello")),
    *(KEYS.robot("r1", topic) for topic in ("measurements", "stop", "ready", "reference")),
    *(KEYS.observe_agent(name, "estimate") for name in ("r1", "r2")),
    KEYS.observe_server("truth"),
    "something/else",
)
TOKENS = (KEYS.agent("r2", "alive"), KEYS.agent("r3", "alive"))
REQUESTS = (KEYS.request("observer"), KEYS.request("operator"))
PLACES: dict[str, tuple[Callable[[Credentials | None], Guard | None], tuple[str, ...]]] = {
    "neighbour plane of r1": (
        lambda own: guard_neighbours(own, KEYS, "r1", ["r2", "r3"]),
        (KEYS.agent("r1", "block"),),
    ),
    "server's link with r1": (
        lambda own: guard_server_for_robot(own, KEYS, "r1"),
        (KEYS.robot("r1", "measurements"), KEYS.robot("r1", "stop")),
    ),
    "server's observers": (lambda own: guard_server_for_observers(own, KEYS), (KEYS.observe_server("truth"),)),
    "observers of r1": (
        lambda own: guard_agent_for_observers(own, KEYS, "r1"),
        (KEYS.observe_agent("r1", "estimate"),),
    ),
}
"""Sessions that can be dialled: their guard, and what is said there."""
OWNERS = {"server's link with r1": "server", "server's observers": "server"}
"""Whose they are, if not r1's."""


@contextmanager
def victim(profile: Profile, place: str) -> Iterator[tuple[str, zenoh.Session]]:
    """The session at one of the places, and where it can be dialled."""
    guard, _ = PLACES[place]
    endpoint = profile.endpoint(free_port())
    credentials = profile.credentials(OWNERS.get(place, "r1"))
    with open_session(listen=[endpoint], guard=guard(credentials)) as session:
        yield endpoint, session


def attack(
    profile: Profile, place: str, attacker: str, listens: tuple[str, ...], mode: str = "peer", **settings: object
) -> tuple[Crossing, Crossing]:
    """What comes to the attacker, and what comes to the victim, when the attacker tries all it can."""
    own_keys = PLACES[place][1]
    with (
        victim(profile, place) as (endpoint, session),
        raw_session([endpoint], tls=tls_settings(profile.credentials(attacker)), mode=mode, **settings) as intruder,
    ):
        # The victim is all ears, too: whatever it does not hear was kept from it, not merely left unread.
        target = Busybody(
            session,
            own_keys,
            listens=("**", *_spoken_to(place)),
            answers=(*REQUESTS, "alive/victim"),
            shows=[KEYS.agent("r1", "alive")],
            watches=("**", *TOKENS),
        )
        enemy = Busybody(
            intruder,
            EVERYTHING,
            (*REQUESTS, "**"),
            listens,
            answers=("alive/intruder",),
            shows=TOKENS,
            watches=listens if listens == ("**",) else ("**", KEYS.agent("r1", "alive")),
        )
        let_act(target, enemy)
        return enemy.came, target.came


def _spoken_to(place: str) -> tuple[str, ...]:
    """What the real listener at the place subscribes to."""
    return {
        "neighbour plane of r1": (f"{KEYS.run}/agent/r2/*", f"{KEYS.run}/agent/r3/*"),
        "server's link with r1": (f"{KEYS.run}/robot/r1/*",),
    }.get(place, ())


MAY_HEAR: dict[tuple[str, str], set[str]] = {
    ("neighbour plane of r1", "r2"): {KEYS.agent("r1", "block")},
    ("neighbour plane of r1", "r3"): {KEYS.agent("r1", "block")},
    ("server's link with r1", "r1"): {KEYS.robot("r1", "measurements"), KEYS.robot("r1", "stop")},
    ("server's observers", "observer"): {KEYS.observe_server("truth")},
    ("server's observers", "operator"): {KEYS.observe_server("truth")},
    ("observers of r1", "observer"): {KEYS.observe_agent("r1", "estimate")},
    ("observers of r1", "operator"): {KEYS.observe_agent("r1", "estimate")},
}
"""What a participant hears at a place if it listens to exactly that; whoever is not named hears nothing."""
MAY_SAY: dict[tuple[str, str], set[str]] = {
    ("neighbour plane of r1", "r2"): {KEYS.agent("r2", "block"), KEYS.agent("r2", "hello")},
    ("neighbour plane of r1", "r3"): {KEYS.agent("r3", "block"), KEYS.agent("r3", "hello")},
    ("server's link with r1", "r1"): {KEYS.robot("r1", "ready"), KEYS.robot("r1", "reference")},
}
MAY_ASK: dict[tuple[str, str], set[str]] = {
    ("server's observers", "observer"): {KEYS.request("observer")},
    ("server's observers", "operator"): {KEYS.request("operator")},
}
MAY_SEE: dict[tuple[str, str], set[str]] = {
    ("neighbour plane of r1", "r2"): {KEYS.agent("r1", "alive")},
    ("neighbour plane of r1", "r3"): {KEYS.agent("r1", "alive")},
}
MAY_SHOW: dict[tuple[str, str], set[str]] = {
    ("neighbour plane of r1", "r2"): {KEYS.agent("r2", "alive")},
    ("neighbour plane of r1", "r3"): {KEYS.agent("r3", "alive")},
}


@pytest.mark.parametrize("place", PLACES)
def test_in_the_open_profile_everything_crosses(place):
    """The attack works where nothing guards against it."""
    to_attacker, to_victim = attack(OPEN, place, "r4", ("**",))
    assert to_attacker.heard >= set(PLACES[place][1])
    assert to_attacker.answered >= set(REQUESTS)
    assert "alive/victim" in to_attacker.alive
    assert to_victim.heard >= set(EVERYTHING)
    assert to_victim.deleted >= set(EVERYTHING)
    assert to_victim.asked >= set(REQUESTS)
    assert "alive/intruder" in to_victim.alive & to_victim.shown
    assert to_victim.shown >= set(TOKENS)
    assert to_attacker.shown >= {"alive/victim", KEYS.agent("r1", "alive")}


@pytest.mark.parametrize("attacker", NAMES)
@pytest.mark.parametrize("place", PLACES)
def test_no_party_does_more_than_it_may(secure, place, attacker):
    """Forged messages, foreign ears, foreign questions, deletions, signs of life: with any valid certificate."""
    places = {f"{key.rpartition('/')[0]}/*" for key in PLACES[place][1]}
    to_attacker, to_victim = attack(secure, place, attacker, ("**", *places))
    assert to_attacker.heard == MAY_HEAR.get((place, attacker), set())
    assert to_victim.heard == MAY_SAY.get((place, attacker), set())
    assert to_attacker.answered == to_victim.asked == MAY_ASK.get((place, attacker), set())
    assert to_victim.deleted == set()
    assert to_attacker.alive == to_attacker.shown == MAY_SEE.get((place, attacker), set())
    assert to_victim.alive == to_victim.shown == MAY_SHOW.get((place, attacker), set())


@pytest.mark.parametrize("place", PLACES)
def test_who_listens_to_everything_hears_no_more_than_it_may(secure, place):
    """Usually it hears nothing, because its subscription is refused. But while a link comes up, Zenoh sends what is not
    subscribed to yet, and on a busy machine some of that arrives: still only what this listener may hear.
    """
    insider = {"neighbour plane of r1": "r2", "server's link with r1": "r1"}.get(place, "observer")
    assert attack(OPEN, place, insider, ("**",))[0].heard >= set(PLACES[place][1])
    assert attack(secure, place, insider, ("**",))[0].heard <= MAY_HEAR[place, insider]


def test_no_robot_hears_the_truth_while_its_link_comes_up_or_later(secure):
    truth = KEYS.observe_server("truth")
    heard: dict[str, set[str]] = {name: set() for name in ("observer", "r1", "r2", "r3", "r4")}
    with victim(secure, "server's observers") as (endpoint, session), ExitStack() as stack:
        is_over = threading.Event()

        def speak() -> None:
            while not is_over.wait(0.0005):
                session.put(truth, b"")

        speaker = threading.Thread(target=speak)
        speaker.start()
        stack.callback(speaker.join)
        stack.callback(is_over.set)
        kept = []
        for name, keys in heard.items():
            tls = tls_settings(secure.credentials(name))
            listener = stack.enter_context(raw_session([endpoint], tls=tls))
            for key in ("**", f"{KEYS.run}/observe/server/*", truth):
                kept.append(listener.declare_subscriber(key, lambda sample, keys=keys: keys.add(str(sample.key_expr))))
        wait_until(lambda: heard["observer"], "an observer to hear it, who may")
        is_over.wait(0.2)
        assert len(kept) == 15
    assert heard == {"observer": {truth}, "r1": set(), "r2": set(), "r3": set(), "r4": set()}


@pytest.mark.parametrize(("mode", "settings"), [("client", PUSHING), ("router", {}), ("router", PUSHING)])
def test_acting_as_a_client_or_a_router_gains_nothing(secure, mode, settings):
    place = "neighbour plane of r1"
    to_attacker, to_victim = attack(OPEN, place, "r4", ("**",), mode, **settings)
    assert to_attacker.heard >= {KEYS.agent("r1", "block")}
    assert to_victim.heard >= {KEYS.agent("r2", "block")}
    to_attacker, to_victim = attack(secure, place, "r4", ("**", f"{KEYS.run}/agent/r1/*"), mode, **settings)
    assert to_attacker.heard == to_attacker.answered == to_victim.heard == to_victim.asked == set()
    to_attacker, to_victim = attack(secure, place, "r2", ("**", f"{KEYS.run}/agent/r1/*"), mode, **settings)
    assert to_attacker.heard == {KEYS.agent("r1", "block")}
    assert to_victim.heard == MAY_SAY[place, "r2"]


@pytest.mark.parametrize("name", ["r2", "r3"])
def test_who_listens_at_a_neighbours_port_does_not_become_that_neighbour(secure, name):
    """r3's certificate is valid for the host, but its name is not r2: nothing of r2's is taken from it."""
    endpoint = secure.endpoint(free_port())
    guard = guard_neighbours(secure.credentials("r1"), KEYS, "r1", ["r2"])
    with (
        open_session(connect=[endpoint], guard=guard) as session,
        raw_session(listen=[endpoint], tls=tls_settings(secure.credentials(name))) as listener,
    ):
        wait_until(lambda: len(listener.info.links()) == 1, "the link")
        target = Busybody(session, [KEYS.agent("r1", "block")], listens=("**", f"{KEYS.run}/agent/r2/*"))
        other = Busybody(listener, EVERYTHING, REQUESTS, ("**", f"{KEYS.run}/agent/r1/*"))
        let_act(target, other)
        if name == "r2":
            assert target.came.heard == MAY_SAY["neighbour plane of r1", "r2"]
            assert other.came.heard == {KEYS.agent("r1", "block")}
        else:
            assert target.came.is_empty
            assert other.came.is_empty


def test_no_agent_passes_for_another_one_or_for_the_server_at_an_observer(secure):
    endpoint = secure.endpoint(free_port())
    guard = guard_observer(secure.credentials("observer"), KEYS, "observer", ["r1", "r2"])
    said = (KEYS.observe_agent("r1", "estimate"), KEYS.observe_agent("r2", "estimate"), KEYS.observe_server("truth"))
    with (
        open_session(connect=[endpoint], guard=guard) as session,
        raw_session(listen=[endpoint], tls=tls_settings(secure.credentials("r2"))) as liar,
    ):
        listens = (f"{KEYS.run}/observe/agent/r1/*", f"{KEYS.run}/observe/agent/r2/*", f"{KEYS.run}/observe/server/*")
        wait_until(lambda: len(liar.info.links()) == 1, "the link")
        observer = Busybody(session, [], [KEYS.request("observer")], listens)
        let_act(observer, Busybody(liar, said, answers=REQUESTS))
        assert observer.came.heard == {KEYS.observe_agent("r2", "estimate")}
        assert observer.came.answered == set()


def test_messages_of_an_old_run_do_not_arrive(secure):
    """The same team, the same certificates, another run: its prefix opens nothing here."""
    old = Keys("the-run-before")
    for profile, arrives in ((OPEN, True), (secure, False)):
        with (
            victim(profile, "neighbour plane of r1") as (endpoint, session),
            raw_session([endpoint], tls=tls_settings(profile.credentials("r2"))) as intruder,
        ):
            target = Busybody(session, [], listens=("**", f"{KEYS.run}/agent/r2/*"))
            let_act(target, Busybody(intruder, [old.agent("r2", "block"), KEYS.agent("r2", "block")]))
            assert (old.agent("r2", "block") in target.came.heard) == arrives
            assert KEYS.agent("r2", "block") in target.came.heard


def test_links_of_those_who_have_no_business_here_are_told_but_not_counted(secure):
    keys, inbox = Keys("run"), Inbox()
    endpoint = secure.endpoint(free_port())
    guard = guard_server_for_robot(secure.credentials("server"), keys, "r1")
    with open_session(listen=[endpoint], guard=guard) as session:
        inbox.watch_links(session, "r1", guard)
        inbox.watch_strangers(session, guard)
        with raw_session([endpoint], tls=tls_settings(secure.credentials("r4"))):
            event = next_event(inbox)
            assert isinstance(event, Refused)
            assert event.source == "r4"
            assert "only r1 may dial" in str(event.error)
        with raw_session([endpoint], tls=tls_settings(secure.credentials("r1"))):
            assert next_event(inbox) == Presence("r1", True)
        assert next_event(inbox) == Presence("r1", False)
