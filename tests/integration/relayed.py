"""Plans in which some edges of the graph lead through a relay."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack

from msgspec import structs

from coheft.app.run.plan import Plan
from tests.ports import free_port

from .relay import Relay

Edge = tuple[str, str]


def with_relays(plan: Plan, edges: Iterable[Edge], stack: ExitStack) -> tuple[Plan, dict[Edge, Relay]]:
    """The plan with relays on some edges, which end with the stack."""
    relays: dict[Edge, Relay] = {}
    agents = dict(plan.agents)
    for edge in edges:
        dialling, listening = sorted(edge, reverse=True)  # who comes first listens
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        relays[edge] = stack.enter_context(Relay(endpoint, agents[listening].listen))
        agents[dialling] = structs.replace(
            agents[dialling],
            neighbours=tuple(
                structs.replace(other, endpoint=endpoint) if other.name == listening else other
                for other in agents[dialling].neighbours
            ),
        )
    return Plan(plan.server, agents, plan.keys), relays
