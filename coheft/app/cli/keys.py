"""The command that makes certificates."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from coheft.app.cli import options
from coheft.app.cli.base import PARTS, app


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
