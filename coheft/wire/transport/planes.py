"""Who may say what to whom on each plane: the secure profile's rules, drawn from the graph.

Each function gives the parties at the far ends of one session; what is said under a key that is not named here does not
arrive. Without credentials there is no guard: the open profile
trusts whoever reaches the port, which is right on one machine's loopback interface only.
"""

from __future__ import annotations

from collections.abc import Iterable

from coheft.wire.transport.security import Credentials, Guard, Party
from coheft.wire.transport.sessions import ROLES, Keys, Role

SERVER = "server"
"""The server's name in its certificate."""


def guard_server_for_robot(credentials: Credentials | None, keys: Keys, robot: str) -> Guard | None:
    """Robot plane, the server's end of one robot's link."""
    return _guard(credentials, [Party(robot, says=_up(keys, robot), hears=_down(keys, robot))])


def guard_robot(credentials: Credentials | None, keys: Keys, robot: str) -> Guard | None:
    """Robot plane, the robot's end."""
    return _guard(credentials, [Party(SERVER, says=_down(keys, robot), hears=_up(keys, robot))])


def guard_neighbours(credentials: Credentials | None, keys: Keys, own: str, others: Iterable[str]) -> Guard | None:
    """Neighbour plane: every neighbour speaks for itself only, and hears us alone."""
    hears, watches = (keys.agent(own, "*"),), (keys.agent(own, "alive"),)
    return _guard(
        credentials,
        [
            Party(other, (keys.agent(other, "alive"),), watches, says=(keys.agent(other, "*"),), hears=hears)
            for other in others
        ],
    )


def guard_server_for_observers(credentials: Credentials | None, keys: Keys) -> Guard | None:
    """Observer plane, the server's end: each role asks under a key of its own, so its requests tell who asks."""
    return _guard(credentials, [Party(role, hears=_of_server(keys), asks=(keys.request(role),)) for role in ROLES])


def guard_agent_for_observers(credentials: Credentials | None, keys: Keys, agent: str) -> Guard | None:
    """Observer plane, an agent's end: only the operator may ask it for anything."""
    return _guard(
        credentials, [Party(role, hears=_of_agent(keys, agent), asks=_asked(keys, agent, role)) for role in ROLES]
    )


def guard_observer(credentials: Credentials | None, keys: Keys, role: Role, agents: Iterable[str]) -> Guard | None:
    """Observer plane, the observer's end: no agent can pass for another one, or for the server."""
    server = Party(SERVER, says=_of_server(keys), answers=(keys.request(role),))
    return _guard(
        credentials,
        [
            server,
            *(Party(agent, says=_of_agent(keys, agent), answers=_asked(keys, agent, role)) for agent in agents),
        ],
    )


def _guard(credentials: Credentials | None, parties: Iterable[Party]) -> Guard | None:
    return None if credentials is None else Guard(credentials, tuple(parties))


def _up(keys: Keys, robot: str) -> tuple[str, ...]:
    return keys.robot(robot, "ready"), keys.robot(robot, "reference")


def _down(keys: Keys, robot: str) -> tuple[str, ...]:
    return keys.robot(robot, "measurements"), keys.robot(robot, "stop")


def _of_server(keys: Keys) -> tuple[str, ...]:
    return tuple(keys.observe_server(topic) for topic in ("truth", "problem", "end"))


def _asked(keys: Keys, agent: str, role: Role) -> tuple[str, ...]:
    return (keys.request_agent(agent),) if role == "operator" else ()


def _of_agent(keys: Keys, agent: str) -> tuple[str, ...]:
    return keys.observe_agent(agent, "estimate"), keys.observe_agent(agent, "problem")
