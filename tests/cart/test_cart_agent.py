"""Pushers who know their own wrench only: together they know as much as one who pushes alone, and share the work."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from msgspec import structs

from coheft.agents.cart.agent import CartAgent
from coheft.app.cart.inprocess import CartRun, neighbours_of, run_in_process
from coheft.app.cart.judge import judge
from coheft.app.cart.table_one import table_one
from coheft.physics_server.cart.physics import CartSimulation
from coheft.wire.cart.config import agent_config
from coheft.wire.cart.messages import CartMessage, CartPush

DURATION = 13.0

pytestmark = pytest.mark.timeout(600)


@cache
def run(pushers: int, duration: float = DURATION) -> CartRun:
    return run_in_process(structs.replace(table_one(6, pushers=pushers), duration=duration))


@pytest.mark.slow
def test_several_find_the_same_cart_as_one_alone() -> None:
    alone, together = judge(run(1), 6), judge(run(3), 6)
    for report in (alone, together):
        assert abs(report.mass_error_kg) < 0.03
        assert report.com_error_mm < 1.0
        assert report.com_known
        assert report.largest_tracking_error_m < 0.03
    # Every robot measures the cart's motion: together they know it better.
    assert together.mass_std_kg < 0.9 * alone.mass_std_kg
    assert together.mean_effort_n < alone.mean_effort_n
    last = [estimates[-1] for estimates in run(3).estimates.values()]
    assert {estimate.members for estimate in last} == {3}
    for estimate in last[1:]:
        np.testing.assert_allclose(estimate.cart.phi, last[0].cart.phi, rtol=1e-9)


def test_no_hand_does_it_all() -> None:
    """Each of three does about a third of the push ahead."""
    scenario = structs.replace(table_one(5, pushers=3), duration=3.0)
    graph = neighbours_of(scenario)
    simulation = CartSimulation(scenario)
    agents = {name: CartAgent(agent_config(scenario, name, graph[name])) for name in scenario.names}
    pushes: dict[int, dict[str, CartPush]] = {}
    messages: dict[str, CartMessage] = {}
    ahead = []
    for block in range(scenario.blocks):
        now = pushes.pop(block, {})
        ahead.append([now[name].wrench[0] if name in now else 0.0 for name in scenario.names])
        sample = simulation.advance(now)
        told = {}
        for name, agent in agents.items():
            inbox = [messages[other] for other in graph[name] if other in messages]
            outbox = agent.step(sample.measurements[name], inbox)
            told[name] = outbox.message
            pushes.setdefault(outbox.push.block, {})[name] = outbox.push
        messages = told
    mean = np.mean(ahead[100:300], axis=0)
    assert mean.sum() == pytest.approx(16.0 + 5.0, rel=0.15)  # mass times acceleration, and friction
    assert mean.min() > 0.1 * mean.sum()


def test_messages_that_do_not_come_cost_samples_and_nothing_else() -> None:
    """A tenth of all messages between two pushers is lost."""
    scenario = structs.replace(table_one(5, pushers=2), duration=7.0)
    graph = neighbours_of(scenario)
    simulation = CartSimulation(scenario)
    agents = {name: CartAgent(agent_config(scenario, name, graph[name])) for name in scenario.names}
    rng = np.random.default_rng(1)
    pushes: dict[int, dict[str, CartPush]] = {}
    messages: dict[str, CartMessage] = {}
    estimate = None
    for block in range(scenario.blocks):
        sample = simulation.advance(pushes.pop(block, {}))
        told = {}
        for name, agent in agents.items():
            inbox = [messages[other] for other in graph[name] if other in messages and rng.random() > 0.1]
            outbox = agent.step(sample.measurements[name], inbox)
            told[name] = outbox.message
            pushes.setdefault(outbox.push.block, {})[name] = outbox.push
            estimate = outbox.estimate or estimate
        messages = told
    assert estimate is not None
    assert abs(estimate.cart.mass - 20.0) < 0.1
    assert abs(estimate.cart.mass - 20.0) < 4.0 * np.sqrt(estimate.covariance[0, 0])


@pytest.mark.slow
def test_a_hand_slides_to_where_it_pushes_best() -> None:
    """The centre of mass is 15 cm to the right, so is the best place; staying in the middle takes more effort."""
    sliding = run(1, 10.0)
    staying = run_in_process(structs.replace(sliding.scenario, slides=False))
    effort, more = (np.mean([truth.effort for truth in each.truths]) for each in (sliding, staying))
    assert effort < 0.95 * more
