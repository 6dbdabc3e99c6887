"""A run with a cart in one process, with the same pure cores and results as in separate processes."""

from dataclasses import dataclass

from coheft.agents.cart.agent import CartAgent
from coheft.consensus.graph import build_graph
from coheft.physics_server.cart.physics import CartSimulation
from coheft.wire.cart.config import agent_config
from coheft.wire.cart.messages import CartEstimate, CartMessage, CartPush, CartTruth
from coheft.wire.cart.scenario import CartScenario
from coheft.wire.scenario.schema import Graph


@dataclass(frozen=True, eq=False)
class CartRun:
    """Results of a run: the truth at every sample, and each pusher's estimates, ten per second, by its name."""

    scenario: CartScenario
    truths: list[CartTruth]
    estimates: dict[str, list[CartEstimate]]


def neighbours_of(scenario: CartScenario) -> dict[str, tuple[str, ...]]:
    """The graph of the pushers: a line along the handle."""
    if scenario.pushers == 1:
        return {scenario.names[0]: ()}
    return build_graph(Graph(kind="line"), scenario.names)


def run_in_process(scenario: CartScenario) -> CartRun:
    """Run a scenario to its end; raise a ``SimulationError`` if the cart moves out of bounds."""
    graph = neighbours_of(scenario)
    simulation = CartSimulation(scenario)
    agents = {name: CartAgent(agent_config(scenario, name, graph[name])) for name in scenario.names}
    pushes: dict[int, dict[str, CartPush]] = {}
    messages: dict[str, CartMessage] = {}
    run = CartRun(scenario, [], {name: [] for name in scenario.names})
    for block in range(scenario.blocks):
        sample = simulation.advance(pushes.pop(block, {}))
        run.truths.append(sample.truth)
        sent: dict[str, CartMessage] = {}
        for name, agent in agents.items():
            inbox = [messages[other] for other in graph[name] if other in messages]
            outbox = agent.step(sample.measurements[name], inbox)
            sent[name] = outbox.message
            pushes.setdefault(outbox.push.block, {})[name] = outbox.push
            if outbox.estimate is not None:
                run.estimates[name].append(outbox.estimate)
        messages = sent
    return run
