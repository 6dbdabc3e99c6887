"""Commands that start parts by hand, make their certificates, and link them with ROS 2."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from coheft.app.cli import options
from coheft.app.cli.base import PARTS, app

Config = Annotated[
    options.GivenPath, Parameter(help="Its configuration, as 'coheft run --write-configs DIR' writes it.")
]
ROUTER = "tcp/127.0.0.1:7447"
Time = Annotated[float, Parameter(validator=Number(gte=0))]
Domain = Annotated[
    options.Whole, Parameter(validator=Number(gte=0, lte=232), help="Number of the ROS domain, as in ROS_DOMAIN_ID.")
]
Endpoint = Annotated[str, Parameter(help="Where the router of ROS 2 listens ('ros2 run rmw_zenoh_cpp rmw_zenohd').")]


@app.command(group=PARTS)
def keys(
    folder: options.NewFolder,
    scenario: options.ScenarioName = "ring6",
    *,
    hosts: options.GivenPath | None = None,
    days: Annotated[float, Parameter(validator=Number(gt=0, lte=36500))] = 365.0,
) -> None:
    """Make a certificate authority and one certificate for each robot, the server, observers and the operator.

    Args:
        folder: Folder for the files. Each host needs authority.crt, and the .crt and .key files of the parts that run
            on it.
        hosts: File that names the host of each part, see docs/deployment.md; by default all run on this machine.
        days: Number of days after which all certificates expire.
    """
    from datetime import timedelta

    from coheft.app.run.hosts import load_hosts
    from coheft.app.run.keys import make_keys
    from coheft.wire.scenario.file import load_scenario

    chosen = load_scenario(scenario)
    places = load_hosts(hosts, chosen) if hosts is not None else None
    names = make_keys(folder, chosen, places, timedelta(days=days))
    print(f"made {folder}: an authority, and certificates of {', '.join(names)}; they expire in {days:g} days")
    print("With authority.key, anyone can make more certificates: keep it on a host where no part runs.")


@app.command(group=PARTS)
def server(config: Config) -> int:
    """Start a physics server by hand."""
    return _start_by_hand("coheft.physics_server.server", config)


@app.command(group=PARTS)
def agent(config: Config) -> int:
    """Start one robot by hand."""
    return _start_by_hand("coheft.agents.process.main", config)


def _start_by_hand(module: str, config: Path) -> int:
    from coheft.app.run.processes import run_in_foreground

    return run_in_foreground(module, config)


@app.command(group=PARTS)
def ros2_bridge(
    run: options.ShownRun = None, *, domain: Domain = 0, endpoint: Endpoint = ROUTER, namespace: str = ""
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
