"""The supervisor: starts the processes of a run, follows the run, and ends them all with it."""

import select
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, NamedTuple

from coheft.agents.process.heartbeat import Heartbeat
from coheft.app.names import few
from coheft.app.results.record import Record
from coheft.app.results.report import Report, build_report
from coheft.app.run.ctrl_c import SENTENCE, FirstCtrlC
from coheft.app.run.folder import RunFile, announce, announced, has_gone, note_end, noted_end
from coheft.app.run.follower import Follower
from coheft.app.run.fork_server import ForkServer
from coheft.app.run.observer import Observer, observe
from coheft.app.run.plan import Plan
from coheft.app.run.processes import Processes, make_fork_server
from coheft.app.terminal.digits import seconds_of
from coheft.app.terminal.screen import Display
from coheft.app.terminal.standard_output import lost_output
from coheft.errors import CoheftError, LinkError
from coheft.wire.messages.requests import RunState, Status, StatusRequest
from coheft.wire.messages.structs import Problem
from coheft.wire.process.supervised import BEAT, STOP, UNUSABLE
from coheft.wire.transport.planes import SERVER

_POLL = 0.02
_GATHER = 0.03
"""Time to wait for further messages after the first one [s]: a run is evaluated about twenty times a second, however
fast it is, and the end of a process is noticed within 50 ms."""
_START_LIMIT = 60.0
_COMMENT_AFTER = 5.0
_COMMENT_EVERY = 2.0
_SILENCE = 2.0
_STOPPED = 2.0
_END_SILENCE = 3.0
"""Time without news after Ctrl-C for which a part may go on [s]."""
_FINAL_MESSAGES = 1.0
_WRITING_LIMIT = 120.0  # the server may have a long recording to write before it answers
_AGENTS_END = 5.0


def launch(
    plan: Plan,
    folder: Path,
    display: Display,
    *,
    followers: Sequence[Follower] = (),
    with_history: bool = False,
    restarts: int = 0,
    fork_server: ForkServer | None = None,
    ctrl_c: FirstCtrlC | None = None,
) -> Report:
    """Run a plan to its end, and compare the robots' estimates with the truth.

    Processes are forked by ``fork_server``, or by a new one if the platform supports that.

    An agent that fails during the run is restarted, up to ``restarts`` times. The server is not, because the simulated
    world ends with it.

    With ``ctrl_c``, which begins when the clock has started, the first Ctrl-C ends the run as ``coheft stop`` does.

    Raises:
        ProcessError: A process failed, or an agent failed too often; the others have been stopped.
        LinkError: The processes did not find each other.
        KeyboardInterrupt: The user pressed Ctrl-C; with ``ctrl_c``, before the clock had started, or twice, or for a
            reason that is named: the server did not react, or there were no estimates yet.
    """
    scenario = plan.server.scenario
    fork_server = fork_server or make_fork_server()
    # Processes end before the observer's links, which a frozen process would keep from closing.
    with observe(plan.run_file()) as observer, Processes(folder, fork_server) as processes, display:
        server = processes.start(SERVER, "coheft.physics_server.server", plan.server)
        for name, agent in plan.agents.items():
            processes.start(name, "coheft.agents.process.main", agent)
        stdin = server.process.stdin
        assert stdin is not None
        # A supervisor that is stopped (Ctrl-Z, SIGSTOP) would miss the rest of its run, and its report would be missing
        # or wrong. So the server pauses the run while no heartbeat arrives, and then resumes it.
        beating = Heartbeat(lambda: _write(stdin, b"\n"), BEAT)
        with announced(folder, plan.run_file(processes.pids)), beating:
            again = Restarts(
                restarts, processes, observer, display, lambda: announce(folder, plan.run_file(processes.pids))
            )
            first = _wait_for_start(observer, again, display)
            display.begin(first)
            record = Record.of(scenario, first.scene, with_history=with_history)
            audience = Audience(record, display, followers, is_told_end=False)
            for follower in followers:
                follower.begin(first)
            is_saving = plan.server.save_data is not None
            if ctrl_c is not None:
                ctrl_c.begin()
            end = EndByCtrlC(ctrl_c or FirstCtrlC(), stdin, display)
            status = _follow(audience, observer, processes, again, end, is_saving=is_saving)
            with suppress(CoheftError):  # for instance a full disk, which must not cost the report
                note_end(folder, status.time)
            for follower in followers:
                follower.end(status)
    if record.truth is None or record.silent:
        if end.ctrl_c.is_pressed:
            raise KeyboardInterrupt("not every robot had sent an estimate yet")
        raise LinkError(f"the run ended before every robot had sent an estimate; see the logs in {folder}")
    report = build_report(scenario, record, real_time_factor=status.real_time_factor, late_blocks=status.late_blocks)
    if report.beside:
        from coheft.app.study.bounds import with_bound  # which loads the physics

        report = with_bound(report, scenario, record.truth)
    return report


class Collected(NamedTuple):
    """Whether any messages have arrived, and whether the simulated time has advanced."""

    has_arrived: bool
    goes_on: bool


@dataclass(frozen=True)
class Audience:
    """All parts of this process that receive an observer's messages.

    The display shows why a run was aborted only if it ``is_told_end``; the supervisor raises that as an error instead.
    """

    record: Record
    display: Display
    followers: Sequence[Follower] = ()
    is_told_end: bool = True

    def collect(self, observer: Observer, seconds: float = _POLL) -> Collected:
        """Process the messages that have arrived, and show them."""
        before, arrived = self.record.time, observer.collect(self.record.scene, seconds, _GATHER)
        for news in arrived:
            self.record.receive(news)
            if isinstance(news, Problem) and (self.is_told_end or not news.is_end):
                self.display.problem(news)
            for follower in self.followers:
                follower.receive(news)
        self.display.update(self.record)
        return Collected(bool(arrived), self.record.time > before)


@dataclass(frozen=True)
class Restarts:
    """Restarts agents that fail, each up to ``limit`` times, shows that, and announces their new process ids."""

    limit: int
    processes: Processes
    observer: Observer
    display: Display
    announce: Callable[[], None]

    def check(self, *, has_begun: bool = True) -> None:
        """Restart agents that have failed; a ``ProcessError`` says why that is not possible (any more).

        Before the run has begun, it is enough that the server's process runs, which may answer late.
        """
        failed = self.processes.failed
        if not failed:
            return
        goes_on = self._goes_on if has_begun else lambda: not self.processes.ended(SERVER)
        is_server_there = all(child.name != SERVER for child in failed)
        may_try_again = all(child.restarts < self.limit and child.status != UNUSABLE for child in failed)
        if not (is_server_there and may_try_again and goes_on()):
            self.processes.check(self.limit if is_server_there else None)
        for child in failed:
            text = f"{child.name} {child.how_and_why}; restarted ({child.restarts + 1} of {self.limit})"
            self.processes.start_again(child)
            self.display.problem(Problem(source="supervisor", text=text))
        try:
            self.announce()
        except CoheftError as error:  # the run continues, although other commands may not find it
            self.display.problem(Problem(source="supervisor", text=str(error)))

    def _goes_on(self) -> bool:
        while (status := self.observer.status()) is None:
            if self.observer.has_lost_server or self.processes.ended(SERVER):
                return False
        return status.state in (RunState.RUNNING, RunState.PAUSED)


def _write(stdin: IO[bytes], line: bytes) -> None:
    with suppress(OSError, ValueError):  # the server has ended, or its stdin is closed
        if select.select([], [stdin], [], 0.0)[1]:  # do not wait for a frozen server, which reads nothing
            stdin.write(line)
            stdin.flush()


@dataclass(frozen=True)
class EndByCtrlC:
    """Ends a run after the first Ctrl-C: asks the server, on its stdin, to end it as ``coheft stop`` does."""

    ctrl_c: FirstCtrlC
    stdin: IO[bytes]
    display: Display

    def begins(self) -> bool:
        """Ask for the end if there has been a first Ctrl-C since the last call; return whether there has."""
        if not self.ctrl_c.take():
            return False
        self.display.tell(SENTENCE)
        _write(self.stdin, STOP)
        return True

    def kill_frozen(self, observer: Observer, processes: Processes, *, is_saving: bool) -> bool:
        """Kill agents that do not end, and return whether there were any.

        A ``KeyboardInterrupt`` says that the server does not answer either. If some agents have ended, it has reacted,
        and does not answer while it saves data.
        """
        has_reacted = any(processes.ended(child.name) for child in processes.children if child.name != SERVER)
        while not (is_saving and has_reacted) and observer.status() is None:
            if observer.has_lost_server or processes.ended(SERVER):
                raise KeyboardInterrupt("the server does not answer")
        if frozen := processes.kill_all_but(SERVER):
            self.display.tell(f"killed, because of no answer within {_END_SILENCE:g} s: {few(frozen)}")
        return bool(frozen)


def _wait_for_start(observer: Observer, again: Restarts, display: Display) -> Status:
    """Wait until all links are up and the clock runs. The limit counts from the last new link, whatever their
    number.
    """
    began = moved_at = time.monotonic()
    comment_at = began + _COMMENT_AFTER
    waiting_for = [SERVER]
    while time.monotonic() < moved_at + _START_LIMIT:
        again.check(has_begun=False)
        status = observer.status()
        if status is not None:
            if status.state is not RunState.WAITING:
                return status
            if status.waiting_for != waiting_for:
                waiting_for, moved_at = status.waiting_for, time.monotonic()
        if time.monotonic() > comment_at:
            comment_at = time.monotonic() + _COMMENT_EVERY
            display.note(f"waiting for {few(waiting_for)}")
        time.sleep(_POLL)
    raise LinkError(f"after {time.monotonic() - began:.0f} s there is still no link with {few(waiting_for)}")


def _follow(
    audience: Audience, observer: Observer, processes: Processes, again: Restarts, end: EndByCtrlC, *, is_saving: bool
) -> Status:
    """Process messages until all agents have ended; return the server's final status, or raise a ``LinkError``.

    Saving may take long: while the server runs, only Ctrl-C interrupts it. A ``ProcessError`` says that a process has
    failed, possibly the server after the agents, or that an agent does not end although the run is over. After
    ``end``, such an agent is killed instead.
    """
    news, has_killed = time.monotonic(), False
    while not processes.all_done_but(SERVER) or processes.failed:
        if end.begins():
            news = time.monotonic()
        again.check()
        looked_at = time.monotonic()
        has_arrived, goes_on = audience.collect(observer)
        if (gap := time.monotonic() - looked_at) > _STOPPED:
            audience.display.note(f"this process was stopped for {gap:.0f} s, and time stood still for most of that")
        if goes_on:
            news = time.monotonic()
        elif end.ctrl_c.is_pressed:
            if has_arrived:
                news = time.monotonic()
            elif time.monotonic() > news + _END_SILENCE:
                has_killed = end.kill_frozen(observer, processes, is_saving=is_saving)
                break
        elif time.monotonic() > news + _SILENCE:
            status = observer.status()
            if processes.ended(SERVER) or (status is not None and status.state is RunState.FINISHED):
                processes.wait_for_all_but(SERVER, _AGENTS_END)
            elif status is not None:
                _explain_silence(status, audience.display)
                news = time.monotonic()  # the next explanation comes a while later
    if not has_killed:
        processes.check()
    deadline = time.monotonic() + _FINAL_MESSAGES
    while time.monotonic() < deadline and not audience.record.complete:
        audience.collect(observer)
    deadline += _WRITING_LIMIT
    while (status := observer.status()) is None or status.failure or status.state is not RunState.FINISHED:
        end.begins()
        has_ended = processes.ended(SERVER)
        if not has_killed:
            processes.check()  # a failed server is about to end
        if is_saving and not has_ended:
            audience.display.note("the server is writing the robots' measurements")
        elif has_ended or time.monotonic() > deadline:
            failure = "" if status is None else status.failure
            raise LinkError(failure or "the server did not report how the run ended")
        time.sleep(_POLL)
    return status


def watch(folder: Path, run_file: RunFile, display: Display) -> str:
    """Show a run that another process supervises until it has ended; return a sentence that says when that was.

    Raises:
        LinkError: The server does not answer, or reports that the run was aborted.
        OSError: Standard output is closed.
    """
    with display, ExitStack() as links:
        display.note("waiting for the server of the run to answer")
        observer = links.enter_context(observe(run_file))
        status = observer.ask(StatusRequest())
        display.note(f"watching {status.scenario}, which is at {seconds_of(status.time, status.duration)}")
        display.begin(status)
        if status.state is not RunState.RUNNING:
            _explain_silence(status, display)
        audience = Audience(Record(status.scene, status.duration, status.estimator), display)
        news = time.monotonic()
        while status.state is not RunState.FINISHED:
            if failure := lost_output():
                raise failure
            if audience.collect(observer).goes_on:
                news = time.monotonic()
            if time.monotonic() < news + _SILENCE and not observer.has_ended:
                continue
            answer = observer.status()
            news = time.monotonic()
            if answer is not None:
                status = answer
                _explain_silence(status, display)
                continue
            if run_file.pids and has_gone(run_file):  # a supervisor never restarts its server
                if (end := noted_end(folder)) is not None:  # a process that is busy or stopped misses last messages
                    return _ended_at(end)
                raise LinkError(f"the run was aborted: its server ended after {audience.record.time:.1f} s")
            observer.check_server()
            display.note("the server does not answer")
    if status.failure:  # the display has shown it
        raise LinkError(f"the run was aborted at {status.time:.2f} s")
    return _ended_at(status.time)


def _ended_at(time: float) -> str:
    return f"the run has ended at {time:.2f} s"


def _explain_silence(status: Status, display: Display) -> None:
    if status.state is RunState.PAUSED:
        display.note(f"paused at {status.time:.2f} s; 'coheft resume' continues")
    elif status.waiting_for:
        display.note(f"waiting for {few(status.waiting_for)}")
