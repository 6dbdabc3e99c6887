"""What a robot makes its neighbour believe of others: in the secure profile nothing, in the open one for a while."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import zenoh
from msgspec.structs import replace

from coheft.app.run.keys import make_keys
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.requests import StatusRequest
from coheft.wire.messages.structs import LinkState, NeighbourMessage

from .attacker import Profile, raw_session, tls_settings
from .team import Team, running_team, small_scenario, wait_until
from .watcher import watching

Lie = Callable[[NeighbourMessage], list[LinkState]]
FAR_AHEAD = 2**62 - 1


def far_too_new(said: NeighbourMessage) -> list[LinkState]:
    return [LinkState("r4", 0, ("r3",), incarnation=FAR_AHEAD)]


def newer(said: NeighbourMessage) -> list[LinkState]:
    return [LinkState("r4", 0, ("r3",), incarnation=said.incarnation + 10**15)]


def elsewhere(said: NeighbourMessage) -> list[LinkState]:
    return [LinkState("r4", 0, ("r9",), incarnation=said.incarnation + 10**15, since=2**60)]


def made_up(said: NeighbourMessage) -> list[LinkState]:
    return [LinkState(f"x{said.block}-{number}", 0, ("r1", "r2")) for number in range(30)]


@contextmanager
def lying(team: Team, profile: Profile, lie: Lie) -> Iterator[list[int]]:
    """Somebody with all that is r2's tells r1 what r2 tells it, but for what it hands on; gives the blocks."""
    key, done = team.keys.agent("r2", "block"), list[int]()
    ears, mouth = (tls_settings(profile.credentials(name)) for name in ("r1", "r2"))
    with (
        raw_session([team.plan.agents["r1"].listen], tls=mouth) as says,
        raw_session([team.plan.agents["r2"].listen], tls=ears) as hears,
    ):
        publisher = says.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)

        def pass_on(sample: zenoh.Sample) -> None:
            said = decode(sample.payload.to_bytes(), NeighbourMessage, key)
            publisher.put(encode(replace(said, gossip=lie(said)), key))
            done.append(said.block)

        with hears.declare_subscriber(
            f"{key.rpartition('/')[0]}/*", lambda s: pass_on(s) if str(s.key_expr) == key else None
        ):
            yield done


@pytest.mark.parametrize(
    ("profile", "lie"),
    [*(("secure", lie) for lie in (far_too_new, newer, elsewhere, made_up)), ("open", newer), ("open", elsewhere)],
)
def test_lies_about_third_robots_end_with_the_liar(profile, lie, tmp_path):
    scenario = small_scenario(4, "line")
    keys = tmp_path / "keys" if profile == "secure" else None
    if keys is not None:
        make_keys(keys, scenario)
    with running_team(scenario, tmp_path, keys_folder=keys) as team:
        team.wait_for_block(1)
        with watching(team) as watcher:
            begin = watcher.wait_until_valid()
            with lying(team, Profile(keys), lie) as told:
                wait_until(lambda: len(told) >= 60, "lies")
            block = team.ask(StatusRequest()).block
            watcher.wait_until_valid(block + 20)
            assert {estimate.members for estimate in watcher.latest.values()} == {4}
            if profile == "secure":  # no lie was believed for a moment
                assert not any(watcher.is_told(name, "the team is not known", begin) for name in team.plan.agents)
                assert "refused from r2: its record of" in team.log("r1")
                assert "not signed" in team.log("r1") or "years" in team.log("r1")
