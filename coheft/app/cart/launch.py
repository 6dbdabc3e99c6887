"""A run with a cart in separate processes: one for its physics, one for each pusher."""

import secrets
import time
from collections.abc import Callable
from pathlib import Path

from coheft.app.cart.inprocess import CartRun, neighbours_of
from coheft.app.run.hosts import free_ports
from coheft.app.run.plan import link_neighbours
from coheft.app.run.processes import Processes
from coheft.errors import LinkError
from coheft.wire.cart.config import CartAgentProcessConfig, CartServerConfig, agent_config
from coheft.wire.cart.messages import CartEstimate, CartTruth
from coheft.wire.cart.scenario import CartScenario
from coheft.wire.messages.structs import Problem
from coheft.wire.transport.inbox import Inbox, Received, Refused
from coheft.wire.transport.sessions import Keys, open_session

_POLL = 0.05
_SILENCE = 60.0
_LAST_WORDS = 1.0
_COLLECT_LIMIT = 0.1  # processes are also checked while messages arrive faster than they are read


def make_configs(scenario: CartScenario, run: str) -> tuple[CartServerConfig, dict[str, CartAgentProcessConfig]]:
    """Make the configurations of all processes of a run; ``run`` is the prefix of its keys."""
    names, graph = scenario.names, neighbours_of(scenario)
    endpoints = iter([f"tcp/127.0.0.1:{port}" for port in free_ports(3 * len(names) + 1)])
    observe = next(endpoints)
    robots = {name: next(endpoints) for name in names}
    listen = {name: next(endpoints) for name in names}
    agents = {
        name: CartAgentProcessConfig(
            agent=agent_config(scenario, name, graph[name]),
            run=run,
            server=robots[name],
            listen=listen[name],
            observe=next(endpoints),
            neighbours=link_neighbours(name, graph[name], listen),
        )
        for name in names
    }
    return CartServerConfig(scenario=scenario, run=run, robots=robots, observe=observe), agents


def run_in_processes(
    scenario: CartScenario, make_folder: Callable[[str], Path], on_problem: Callable[[str], object]
) -> CartRun:
    """Run a scenario to its end.

    ``make_folder`` makes a folder for the logs of a run, given its name; ``on_problem`` is called with each problem
    that a process reports.

    Raises:
        ProcessError: A process failed; the others have been stopped.
        LinkError: The processes did not find each other, or too many messages were lost to judge the run.
    """
    server, agents = make_configs(scenario, f"cart-{secrets.token_hex(4)}")
    keys, folder = Keys(server.run), make_folder(server.run)
    run = CartRun(scenario, [], {name: [] for name in agents})
    inbox = Inbox()
    observed = [server.observe, *(agent.observe for agent in agents.values())]
    with Processes(folder) as processes, open_session(connect=observed) as session:
        truth, problem = keys.observe_server("truth"), keys.observe_server("problem")
        inbox.listen(session, "server", {truth: CartTruth, problem: Problem})
        for name in agents:
            estimate, problem = keys.observe_agent(name, "estimate"), keys.observe_agent(name, "problem")
            inbox.listen(session, name, {estimate: CartEstimate, problem: Problem})
        processes.start("server", "coheft.physics_server.cart.server", server)
        for name, agent in agents.items():
            processes.start(name, "coheft.agents.cart.process", agent)
        news = time.monotonic()
        # A server that fails stops its agents, and ends after them.
        while not (processes.all_done_but("server") and processes.ended("server")):
            processes.check()
            if _collect(inbox, run, on_problem, _POLL):
                news = time.monotonic()
            elif time.monotonic() > news + _SILENCE:
                raise LinkError(f"no message of the run arrived for {_SILENCE:g} s; see the logs in {folder}")
        processes.check()
        deadline = time.monotonic() + _LAST_WORDS
        while len(run.truths) < scenario.blocks and time.monotonic() < deadline:
            _collect(inbox, run, on_problem, _POLL)
        while _collect(inbox, run, on_problem, 0.0):
            pass  # no process can send more
    check_complete(run, folder)
    return run


def check_complete(run: CartRun, folder: Path) -> None:
    """Raise a ``LinkError`` if too many messages to observers were lost to judge a run."""
    if len(run.truths) < run.scenario.blocks:
        raise LinkError(
            f"received {len(run.truths)} of {run.scenario.blocks} samples of the cart, so the run cannot be judged; "
            f"run it again, or see the logs in {folder}"
        )
    if silent := [name for name, estimates in run.estimates.items() if not estimates]:
        raise LinkError(
            f"received no estimate of {', '.join(silent)} in this run; run it again, or see the logs in {folder}"
        )


def _collect(inbox: Inbox, run: CartRun, on_problem: Callable[[str], object], seconds: float) -> bool:
    """Wait for messages, at most ``seconds`` [s], and add them to the run; return whether there were any."""
    event = inbox.receive(seconds)
    is_news = event is not None
    deadline = time.monotonic() + _COLLECT_LIMIT
    while event is not None:
        match event:
            case Received(_, CartTruth() as truth):
                run.truths.append(truth)
            case Received(name, CartEstimate() as estimate):
                run.estimates[name].append(estimate)
            case Received(_, Problem(is_end=False) as problem):  # the supervisor reports why the run ended
                on_problem(f"{problem.source}: {problem.text}")
            case Refused(source, error):
                on_problem(f"{source}: {error}")
        event = inbox.receive(0.0) if time.monotonic() < deadline else None
    return is_news
