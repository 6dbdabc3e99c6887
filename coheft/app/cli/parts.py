"""Commands that start parts by hand, and make their certificates."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from coheft.app.cli import options
from coheft.app.cli.base import PARTS, app

Config = Annotated[
    options.GivenPath, Parameter(help="Its configuration, as 'coheft run --write-configs DIR' writes it.")
]


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
