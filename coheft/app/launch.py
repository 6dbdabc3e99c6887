"""The supervisor: starts the processes of a run, follows it, and never leaves one behind."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

from coheft.app.observer import Observer
from coheft.app.plan import Plan
from coheft.app.processes import Processes
from coheft.app.record import Record
from coheft.app.report import Report, RunInfo, build_report
from coheft.app.run_folder import RunFile, announced
from coheft.app.terminal import Display
from coheft.errors import CoheftError, LinkError
from coheft.wire.messages import Status, StatusRequest

_POLL = 0.02
_START_LIMIT = 60.0
_SILENCE = 1.0
_LAST_WORDS = 1.0


def launch(plan: Plan, folder: Path, display: Display, *, with_history: bool = False) -> Report:
    """Run a plan to its end, and compare what the robots found with the truth.

    Raises:
        ProcessError: A process failed; the others have been stopped.
        LinkError: The processes did not find each other.
        KeyboardInterrupt: Ctrl-C, or a polite request to end (SIGTERM).
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run_file = RunFile(
        run=plan.run,
        pid=os.getpid(),
        server=plan.server.observe,
        agents={name: agent.observe for name, agent in plan.agents.items()},
    )
    scenario = plan.server.scenario
    with Processes(folder) as processes, Observer(run_file) as observer, announced(folder, run_file), display:
        processes.start("server", "physics_server.server", plan.server)
        for name, agent in plan.agents.items():
            processes.start(name, "agents.process", agent)
        record = _wait_for_start(observer, processes, display)
        first = time.monotonic()
        last = _follow(record, observer, processes, display)
    if not record.truths or any(not record.estimates.get(name) for name in plan.agents):
        raise LinkError(f"the run ended before every robot had said something; see the logs in {folder}")
    info = RunInfo(
        scenario=scenario.name,
        seed=scenario.seed,
        estimator=scenario.estimator,
        block_duration=scenario.block_duration,
        wall_time=last - first,
    )
    return build_report(info, record.scene, record.truths, record.estimates, with_history=with_history)


def _wait_for_start(observer: Observer, processes: Processes, display: Display) -> Record:
    """Wait until all links stand and the clock runs."""
    deadline = time.monotonic() + _START_LIMIT
    waiting_for: Sequence[str] = ["server"]
    while time.monotonic() < deadline:
        processes.check()
        status = observer.status()
        if status is None:
            time.sleep(_POLL)
            continue
        if status.state != "waiting":
            return _record_of(status)
        if status.waiting_for != waiting_for:
            waiting_for = status.waiting_for
            display.waiting(waiting_for)
        time.sleep(_POLL)
    raise LinkError(f"after {_START_LIMIT:g} s there is still no link with {', '.join(waiting_for)}")


def _record_of(status: Status) -> Record:
    return Record(status.scene, status.duration)


def _follow(record: Record, observer: Observer, processes: Processes, display: Display) -> float:
    """Collect what the processes say until they have ended; return when the last block came."""
    last = time.monotonic()
    while not processes.all_done():
        processes.check()
        if observer.poll(record):
            last = time.monotonic()
            display.update(record)
        else:
            time.sleep(_POLL)
    return last
