"""Commands for users of ROS 2."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from coheft.app.cli import options
from coheft.app.cli.base import PARTS, app

ROUTER = "tcp/127.0.0.1:7447"
Time = Annotated[float, Parameter(validator=Number(gte=0))]
Domain = Annotated[
    options.Whole, Parameter(validator=Number(gte=0, lte=232), help="Number of the ROS domain, as in ROS_DOMAIN_ID.")
]
Endpoint = Annotated[str, Parameter(help="Where the router of ROS 2 listens ('ros2 run rmw_zenoh_cpp rmw_zenohd').")]


@app.command(group=PARTS)
def ros2_bridge(
    run: options.RunFolder = None, *, domain: Domain = 0, endpoint: Endpoint = ROUTER, namespace: str = ""
) -> None:
    """Publish a run in progress as standard ROS 2 messages, for nodes on rmw_zenoh; see docs/ros2.md.

    Args:
        namespace: Prefix of all topics, so that several runs can share a domain.
    """
    from coheft.app.ros2.bridge import bridge_run
    from coheft.app.ros2.names import namespace_of
    from coheft.app.run.folder import find_run

    bridge_run(find_run(run), endpoint, domain, lambda line: print(line, flush=True), namespace_of(namespace))


@app.command(group=PARTS)
def ros2_driver(
    *configs: options.GivenPath,
    domain: Domain = 0,
    endpoint: Endpoint = ROUTER,
    epoch: Time | None = None,
    namespace: str = "",
) -> None:
    """Feed agents with measurements from ROS 2, in place of the physics server; see docs/ros2.md.

    Args:
        configs: The agents' configurations, as 'coheft run --write-configs DIR' writes them, such as DIR/r1.json
            DIR/r2.json.
        epoch: ROS time at which the run begins [s], the same for the whole team. Needed if other processes drive other
            robots of the team; otherwise the run begins when most robots send measurements.
        namespace: Prefix of all topics, so that several teams can share a domain.
    """
    from coheft.app.ros2.drive import drive, read_agents
    from coheft.app.ros2.names import namespace_of

    drive(read_agents(configs), endpoint, domain, epoch, lambda line: print(line, flush=True), namespace_of(namespace))
