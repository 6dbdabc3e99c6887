"""Access rules of the secure profile on each plane, derived from the graph.

Each function returns the parties at the far ends of one session; messages under other keys are dropped. Without
credentials there is no guard: the open profile trusts every process that can connect, and is meant for the loopback
interface only.
"""

from collections.abc import Iterable

from coheft.wire.transport.security import Credentials, Guard, Party
from coheft.wire.transport.sessions import ROLES, Keys, Role

SERVER = "server"
"""The server's name in its certificate."""


def guard_server_for_robot(credentials: Credentials | None, keys: Keys, robot: str) -> Guard | None:
    """Return the rules of the robot plane at the server's end of one robot's link."""
    return _guard(credentials, [Party(robot, sends=_up(keys, robot), receives=_down(keys, robot))])


def guard_robot(credentials: Credentials | None, keys: Keys, robot: str) -> Guard | None:
    """Return the rules of the robot plane at the robot's end."""
    return _guard(credentials, [Party(SERVER, sends=_down(keys, robot), receives=_up(keys, robot))])


def guard_neighbours(credentials: Credentials | None, keys: Keys, own: str, others: Iterable[str]) -> Guard | None:
    """Return the rules of the neighbour plane: each neighbour sends under its own name, and receives ours only."""
    receives, watches = (keys.agent(own, "*"),), (keys.agent(own, "alive"),)
    parties = [
        Party(other, (keys.agent(other, "alive"),), watches, sends=(keys.agent(other, "*"),), receives=receives)
        for other in others
    ]
    return _guard(credentials, parties)


def guard_server_for_observers(credentials: Credentials | None, keys: Keys) -> Guard | None:
    """Return the rules of the observer plane at the server's end. Each role has its own request key."""
    topics = _server_topics(keys)
    return _guard(credentials, [Party(role, receives=topics, requests=(keys.request(role),)) for role in ROLES])


def guard_agent_for_observers(credentials: Credentials | None, keys: Keys, agent: str) -> Guard | None:
    """Return the rules of the observer plane at an agent's end: only the operator may send requests."""
    topics, requests = _agent_topics(keys, agent), {role: _agent_requests(keys, agent, role) for role in ROLES}
    return _guard(credentials, [Party(role, receives=topics, requests=requests[role]) for role in ROLES])


def guard_observer(credentials: Credentials | None, keys: Keys, role: Role, agents: Iterable[str]) -> Guard | None:
    """Return the rules of the observer plane at the observer's end: no agent can imitate another one, or the server."""
    server = Party(SERVER, sends=_server_topics(keys), serves=(keys.request(role),))
    others = [
        Party(agent, sends=_agent_topics(keys, agent), serves=_agent_requests(keys, agent, role)) for agent in agents
    ]
    return _guard(credentials, [server, *others])


def _guard(credentials: Credentials | None, parties: Iterable[Party]) -> Guard | None:
    return None if credentials is None else Guard(credentials, tuple(parties))


def _up(keys: Keys, robot: str) -> tuple[str, ...]:
    return keys.robot(robot, "ready"), keys.robot(robot, "reference")


def _down(keys: Keys, robot: str) -> tuple[str, ...]:
    return keys.robot(robot, "measurements"), keys.robot(robot, "stop")


def _server_topics(keys: Keys) -> tuple[str, ...]:
    return tuple(keys.observe_server(topic) for topic in ("truth", "problem", "end"))


def _agent_requests(keys: Keys, agent: str, role: Role) -> tuple[str, ...]:
    return (keys.request_agent(agent),) if role == "operator" else ()


def _agent_topics(keys: Keys, agent: str) -> tuple[str, ...]:
    return keys.observe_agent(agent, "estimate"), keys.observe_agent(agent, "problem")
