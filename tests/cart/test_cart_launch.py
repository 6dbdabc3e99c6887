"""What observers are told may get lost on a busy machine: a run of which too little was heard is not judged."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from msgspec import structs

from coheft.app.cart.inprocess import CartRun, run_in_process
from coheft.app.cart.judge import judge
from coheft.app.cart.launch import check_complete
from coheft.app.cart.table_one import table_one
from coheft.errors import LinkError
from coheft.wire.cart.scenario import CartLoad

LOGS = Path("logs")


@cache
def run() -> CartRun:
    load = CartLoad(at=5.5, mass=2.0, place=(0.0, 0.0))
    return run_in_process(structs.replace(table_one(6, pushers=2), duration=6.0, loads=(load,)))


def test_a_run_of_which_all_was_heard_is_complete() -> None:
    check_complete(run(), LOGS)


def test_missing_samples_are_told() -> None:
    found = run()
    with pytest.raises(LinkError, match=r"received 599 of 600 samples .* the logs in logs$"):
        check_complete(CartRun(found.scenario, found.truths[1:], found.estimates), LOGS)


def test_a_silent_pusher_is_told() -> None:
    found = run()
    with pytest.raises(LinkError, match=r"received no estimate of p2 .* the logs in logs$"):
        check_complete(CartRun(found.scenario, found.truths, {**found.estimates, "p2": []}), LOGS)


def test_who_was_not_heard_after_a_load_change_has_not_got_over_it() -> None:
    found = run()
    before = {name: [e for e in estimates if e.time < 5.0] for name, estimates in found.estimates.items()}
    assert judge(CartRun(found.scenario, found.truths, before), 6).loads[0].recovered_after_s is None
