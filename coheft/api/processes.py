"""Runs in separate processes."""

from __future__ import annotations

import msgspec
from rich.console import Console

from coheft.api.collector import Collector
from coheft.api.result import Result
from coheft.app.results.carry_record import CarryRecord
from coheft.app.run.folder import make_run_folder
from coheft.app.run.follower import Follower
from coheft.app.run.launch import launch
from coheft.app.run.plan import make_plan, new_run_name
from coheft.app.terminal.screen import make_display
from coheft.wire.scenario.schema import Scenario


def run_processes(scenario: Scenario, *, restarts: int) -> Result:
    """Start the physics server and a process per robot, and follow them to the end; see ``coheft.api.run.run``."""
    name = new_run_name()
    folder = make_run_folder(name)
    collector = Collector()
    carried = None if scenario.carry is None else CarryRecord(scenario)
    followers: list[Follower] = [collector, *([] if carried is None else [carried])]
    display = make_display(Console(stderr=True), quiet=True)
    report = launch(make_plan(scenario, run=name), folder, display, followers=followers, restarts=restarts)
    if carried is not None:
        report = msgspec.structs.replace(report, carry=carried.report())
    return collector.result(scenario, report)
