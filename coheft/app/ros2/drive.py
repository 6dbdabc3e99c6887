"""Robots driven from ROS 2: agents receive measurements of ROS nodes; references and estimates are published."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import msgspec

from coheft.app.ros2.bridge import NODES
from coheft.app.ros2.names import check_ros_names
from coheft.app.ros2.node import open_node
from coheft.app.ros2.team import Team
from coheft.app.run.processes import read_config
from coheft.errors import CoheftError, UsageError
from coheft.wire.config import AgentProcessConfig
from coheft.wire.transport.inbox import Inbox
from coheft.wire.transport.planes import SERVER, guard_observer, guard_server_for_robot
from coheft.wire.transport.security import Credentials, credentials_in
from coheft.wire.transport.sessions import Keys, open_session


def read_agents(paths: Sequence[Path]) -> list[AgentProcessConfig]:
    """Read the configurations of the agents to drive, all of one run, or raise a ``CoheftError``."""
    if not paths:
        raise UsageError("expected the configuration of an agent, as 'coheft run --write-configs DIR' writes it")
    configs = []
    for path in paths:
        try:
            configs.append(msgspec.json.decode(read_config(path), type=AgentProcessConfig))
        except msgspec.ValidationError as error:
            raise CoheftError(f"{path}: expected the configuration of an agent: {error}") from error
    if len({config.run for config in configs}) > 1:
        raise CoheftError(f"{', '.join(map(str, paths))} are of different runs: name agents of one")
    return configs


def drive(
    configs: Sequence[AgentProcessConfig],
    endpoint: str,
    domain: int,
    epoch: float | None,
    tell: Callable[[str], None],
    namespace: str = "",
) -> None:
    """Feed agents of one run with measurements from ROS 2, and publish their references and estimates, until Ctrl-C.

    Block 0 begins at ``epoch``, a ROS time [s], the same for the whole team; None: soon after robots begin to measure,
    if this process drives the whole team. The other arguments are as of ``bridge_run``.

    Raises:
        UsageError: There is no epoch, and other processes drive neighbours of these robots.
        LinkError: There is no router there, or a bridge uses it with the same topics, or something listens where the
            agents dial already.
        CoheftError: ROS does not take a robot's name, or the run is secure and credentials are missing.
    """
    names = [config.agent.name for config in configs]
    check_ros_names(names)
    if epoch is None:
        _check_whole(configs)
    keys, inbox = Keys(configs[0].run), Inbox()
    with ExitStack() as stack:
        node = stack.enter_context(open_node(NODES[1], endpoint, domain, namespace))
        node.check_alone(NODES[:1])  # parts of a team may have separate drivers
        team = Team(node, inbox, tell)
        for config in configs:
            guard = guard_server_for_robot(_credentials(config, SERVER), keys, config.agent.name)
            session = stack.enter_context(open_session(listen=[config.server], guard=guard))
            team.add(config, session, guard)
        guard = guard_observer(_credentials(configs[0], "observer"), keys, "observer", names)
        observer = stack.enter_context(open_session(connect=[config.observe for config in configs], guard=guard))
        team.observe(observer, keys)
        try:
            team.wait_until_ready()
            team.go_on(team.begin(None if epoch is None else round(epoch * 1e9)))
        finally:
            team.stop("the driver has ended")


def _check_whole(configs: Sequence[AgentProcessConfig]) -> None:
    """Check that the configurations are of a whole team: as graphs are connected, no neighbour may be missing."""
    others = {name for config in configs for name in config.agent.neighbours} - {c.agent.name for c in configs}
    if others:
        raise UsageError(
            f"no --epoch, and {', '.join(sorted(others))} not driven here: give all drivers of the team the same "
            "--epoch, in seconds of ROS time, such as 'date +%s' says, or name the agents of the whole team here"
        )


def _credentials(config: AgentProcessConfig, name: str) -> Credentials | None:
    """Return a participant's credentials, from the folder of the agent's own."""
    return None if config.security is None else credentials_in(Path(config.security.authority).parent, name)
