"""What is disturbed is said so that observers can read it."""

from __future__ import annotations

from coheft.wire.messages.told import changed_link, disturbance_in, set_clock
from coheft.wire.scenario.network import LinkQuality


def test_what_is_said_of_links_and_clocks_can_be_read() -> None:
    quality = LinkQuality(loss=0.2, delay=0.1, jitter=0.05)
    told = "20 % lost, others 0.1 to 0.15 s late"
    assert changed_link("r1", quality) == f"the operator has disturbed the link from r1: {told}"
    assert disturbance_in("r2", changed_link("r1", quality)) == (("r1", "r2"), told)
    assert disturbance_in("r2", changed_link("r1", LinkQuality())) == (("r1", "r2"), "")
    assert disturbance_in("server", set_clock("r3", 0.003)) == (("r3",), "0.003 s ahead")
    assert disturbance_in("server", set_clock("r3", 0.0)) == (("r3",), "")
    assert disturbance_in("r2", "the operator has cut the link with r1") is None
