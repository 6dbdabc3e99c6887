"""The physics server's process: the simulation with its network links.

``python -m coheft.physics_server.server`` reads a ``ServerConfig`` from stdin.
"""

import math
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

import zenoh

from coheft.errors import CoheftError, one_line
from coheft.physics_server.clock import Clock, Stopwatch
from coheft.physics_server.data_recorder import DataRecorder
from coheft.physics_server.estimator_choice import check_choice
from coheft.physics_server.request_words import in_words
from coheft.physics_server.robots import ANSWER_LIMIT, Robots
from coheft.physics_server.simulation import Simulation
from coheft.wire.config import ServerConfig
from coheft.wire.data.file import write_recording
from coheft.wire.messages.requests import (
    ClockRequest,
    EstimatorRequest,
    HoldRequest,
    InjectRequest,
    PauseRequest,
    Refusal,
    RemoveRequest,
    RunState,
    Status,
    StatusRequest,
    StopRequest,
)
from coheft.wire.messages.structs import Message
from coheft.wire.process.log import LOG
from coheft.wire.process.problem_log import ProblemLog
from coheft.wire.process.supervised import (
    COMMENT_AFTER,
    has_supervisor_asked_to_stop,
    is_supervisor_stopped,
    supervised_main,
)
from coheft.wire.scenario.plugins import usable_in_run
from coheft.wire.scenario.reach import Reach
from coheft.wire.transport.inbox import Event, Inbox, Presence, Question, Received, Refused
from coheft.wire.transport.planes import SERVER, guard_server_for_observers, guard_server_for_robot
from coheft.wire.transport.robot_link import RobotLink
from coheft.wire.transport.sessions import ROLES, Keys, Role, Sender, open_session

GRACE = 5.0
"""Time for which the server still answers requests after the end of the run [s]."""
_TICK = 0.5
_MAX_EVENTS = 256
"""Number of events read before a block that is due at most, because a sender may be faster than the server."""
_OVER = "the run is over"


class Server:
    """The simulation and its links: one session per robot, one for observers, one inbox for all of them.

    One thread owns everything. Requests wait in the inbox, like references, until a block is complete: load changes
    take effect between two blocks.

    A robot whose link is lost during the run keeps holding the payload at its last reference. Time stands still until
    it is back, or for ``return_limit`` seconds; with the clock ``realtime`` the run continues at once. Without any
    robot for that long, the run ends.
    """

    def __init__(self, config: ServerConfig, robots: dict[str, zenoh.Session], observers: zenoh.Session) -> None:
        scenario, keys = config.scenario, Keys(config.run)
        self._scenario = scenario
        self._clock = Clock(config.clock, scenario.lookahead, scenario.block_duration)
        self._stopwatch = Stopwatch()
        self._simulation = Simulation(scenario, config.neighbours)
        self._estimator = scenario.estimator
        self._state = RunState.WAITING
        self._save_data = config.save_data
        self._unsaved = ""
        self._failure = ""
        self._recorder = DataRecorder(scenario, self._simulation.scene) if config.save_data is not None else None
        self._stop_asked = self._is_suspended = False
        self._inbox = Inbox()
        self._inbox.serve(observers, {keys.request(role): role for role in ROLES})
        self._truth = Sender(observers, keys.observe_server("truth"), may_drop=True)
        self._problems = ProblemLog(SERVER, Sender(observers, keys.observe_server("problem"), may_drop=True))
        self._end = Sender(observers, keys.observe_server("end"), may_drop=True)
        world = time.time_ns()
        links = [
            RobotLink(
                name,
                session,
                self._inbox,
                keys,
                world=world,
                lag=scenario.lookahead,
                block=scenario.sensors.block,
                excess=Reach(scenario.robots).excess,
            )
            for name, session in robots.items()
        ]
        self._robots = Robots(links, self._problems, config.return_limit)
        for name, session in robots.items():
            guard = guard_server_for_robot(config.security, keys, name)
            self._inbox.watch_links(session, name, guard)
            self._inbox.watch_strangers(session, guard)
        self._inbox.watch_strangers(observers, guard_server_for_observers(config.security, keys))

    def run(self) -> None:
        """Wait for all robots, simulate until the end of the run or a request to stop, then stop the robots.

        Raises:
            LinkError: All robots are lost.
            SimulationError: The simulation cannot continue.
        """
        try:
            self._wait_for_robots()
            self._run_blocks()
            self._wait_for_last_answers()
        except CoheftError as error:
            self._failure = str(error)
            self._problems.tell_end(self._failure)
            raise
        except BaseException as error:  # a request to end the process, or unexpected
            self._failure = repr(error)
            raise
        finally:
            self._stopwatch.stop()
            self._state = RunState.FINISHED
            self._robots.send_stop(self._failure or _OVER)
            try:
                self._write_data()
            except BaseException as error:
                self._failure = repr(error)
                raise
            finally:
                self._end.send(self._status())  # its receiver may end this process

    def _write_data(self) -> None:
        if self._recorder is None or self._save_data is None or self._simulation.block == 0:
            return
        try:
            write_recording(self._recorder.recording(), Path(self._save_data))
        except CoheftError as error:  # the other results of the run are still valid
            self._unsaved = str(error)
            self._problems.tell(self._unsaved)

    def linger(self, seconds: float) -> None:
        """Answer requests for some time."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._handle(self._inbox.receive(left))

    def _wait_for_robots(self) -> None:
        comment_at = time.monotonic() + COMMENT_AFTER
        while self._robots.not_ready and not self._stop_asked:
            self._handle(self._inbox.receive(_TICK))
            if time.monotonic() > comment_at:
                comment_at = math.inf
                LOG.info("waiting for %s", ", ".join(self._robots.not_ready))

    def _run_blocks(self) -> None:
        self._go_on()
        blocks = self._scenario.blocks
        while self._simulation.block < blocks:
            self._follow_supervisor()
            # All events are read before the delay is computed, because that looks at every robot.
            for _ in range(_MAX_EVENTS):
                if (event := self._inbox.receive(0.0)) is None:
                    break
                self._handle(event)
            if self._stop_asked:
                return
            delay = self._delay()
            if delay == 0.0:
                self._advance()
            else:
                self._handle(self._inbox.receive(min(delay, _TICK)))
            if self._state is RunState.RUNNING:
                self._robots.check()

    def _follow_supervisor(self) -> None:
        """Pause while the supervising process is stopped, because it would miss the rest of the run.

        If it has asked for the end of the run, that is as good as a request of the operator.
        """
        if has_supervisor_asked_to_stop() and not self._stop_asked:
            self._stop_asked = True
            LOG.info("done for the supervisor before block %d: stop the run", self._simulation.block)
        is_stopped = is_supervisor_stopped()
        if is_stopped and self._state is RunState.RUNNING:
            self._state, self._is_suspended = RunState.PAUSED, True
            self._stopwatch.stop()
            LOG.info("time stands still at block %d: the run's supervisor is stopped", self._simulation.block)
        elif self._is_suspended and not is_stopped:
            self._is_suspended = False
            self._go_on()

    def _delay(self) -> float:
        """Return the time until the next block may be simulated [s]; infinite if that depends on others."""
        if self._state is not RunState.RUNNING or (self._clock.waits_for_robots and self._robots.away):
            return math.inf
        block = self._simulation.block
        answered = self._robots.answered
        return self._clock.delay(block, block if answered is None else answered)

    def _wait_for_last_answers(self) -> None:
        """Let the robots finish the blocks that they have received."""
        deadline = time.monotonic() + ANSWER_LIMIT
        while debtors := self._robots.in_debt:
            left = deadline - time.monotonic()
            if left <= 0.0:
                self._problems.tell(f"no last answer from {', '.join(debtors)}")
                return
            self._handle(self._inbox.receive(left))

    def _advance(self) -> None:
        """Simulate one block, and send each party the results that it may know."""
        block = self._simulation.block
        result = self._simulation.advance(self._robots.take_references(block, block * self._scenario.block_duration))
        if self._recorder is not None:
            self._recorder.add(result)
        self._robots.send_measurements(result.measurements, block, self._estimator)
        self._truth.send(result.truth)
        for problem in result.problems:
            self._problems.tell(problem)

    def _go_on(self) -> None:
        """Start or resume the run."""
        self._state = RunState.RUNNING
        self._stopwatch.start()
        self._clock.start(self._simulation.block)
        self._robots.go_on()

    def _handle(self, event: Event | None) -> None:
        """Process an event."""
        match event:
            case Received(name, message):
                self._robots.take(name, message)
            case Refused(source, error):
                self._problems.tell(f"refused from {source}: {error}")
            case Presence(name, is_here):
                self._robots.note_link(name, is_here)
            case Question(role, request):
                event.answer(self._answer(role, request))

    def _answer(self, role: Role, request: Message) -> Status | Refusal:
        """Carry out a request, if the role is allowed to make it, and log that."""
        try:
            if not isinstance(request, StatusRequest):
                if role != "operator":
                    raise CoheftError(f"only the operator may change a run, not the {role}")
                self._carry_out(request)
                done = f"done for the {role} before block {self._simulation.block}: {in_words(request)}"
                LOG.info("%s", one_line(done))
        except CoheftError as error:
            self._problems.tell(f"refused to the {role}: {in_words(request)}: {error}")
            return Refusal(reason=str(error))
        return self._status()

    def _carry_out(self, request: Message) -> None:
        """Carry out a request."""
        if self._state is RunState.FINISHED:
            raise CoheftError(_OVER)
        match request:
            case InjectRequest():
                self._simulation.inject(request.mass, request.position, request.size)
            case RemoveRequest():
                self._simulation.remove(request.load)
            case HoldRequest(robot=robot, holding=holding) if self._simulation.holds(robot) == holding:
                raise CoheftError(f"{robot} {'already holds' if holding else 'has already released'} the payload")
            case HoldRequest(robot=robot, holding=True):
                self._simulation.grasp(robot)
            case HoldRequest(robot=robot):
                if self._recorder is not None:
                    raise CoheftError("this run writes a data file, which requires that all robots hold the payload")
                if self._simulation.holders == [robot]:
                    raise CoheftError(f"{robot} is the only robot that holds the payload, which would fall")
                self._simulation.release(robot)
            case EstimatorRequest():
                check_choice(request.estimator, self._estimator, self._scenario)
                self._estimator = request.estimator
            case PauseRequest():
                if self._state is RunState.WAITING:
                    raise CoheftError(f"the run has not begun: waiting for {', '.join(self._robots.not_ready)}")
                if request.paused:
                    self._state, self._is_suspended = RunState.PAUSED, False
                    self._stopwatch.stop()
                elif self._state is RunState.PAUSED:
                    self._go_on()
            case ClockRequest():
                self._simulation.set_clock(request.robot, request.ahead)
                what = f"the clock of {request.robot}"
                ahead = f"set {what}: {request.ahead:g} s ahead" if request.ahead else f"restored {what}"
                self._problems.tell(f"the operator has {ahead}")
            case StopRequest():
                self._stop_asked = True

    def _status(self) -> Status:
        block, wall_time, robots = self._simulation.block, self._stopwatch.elapsed, self._robots
        time_simulated = block * self._scenario.block_duration
        return Status(
            scenario=self._scenario.name,
            state=self._state,
            block=block,
            time=time_simulated,
            duration=self._scenario.duration,
            real_time_factor=time_simulated / wall_time if wall_time > 0.0 else 0.0,
            late_blocks=robots.late_references,
            loads=self._simulation.loads.states,
            slots_free=self._simulation.loads.slots_free,
            waiting_for=robots.not_ready if self._state is RunState.WAITING else robots.away + robots.in_debt,
            estimator=self._estimator,
            estimators=usable_in_run(self._scenario.estimator),
            scene=self._simulation.scene,
            unsaved=self._unsaved,
            failure=self._failure,
        )


def run_server(config: ServerConfig) -> None:
    """Run the server to the end of the run, then answer requests for ``GRACE`` seconds.

    Raises:
        LinkError: Another process listens at one of its endpoints, or all robots are lost.
        ScenarioError: The scenario cannot be simulated.
        SimulationError: The simulation cannot continue.
    """
    with ExitStack() as stack:
        keys = Keys(config.run)
        # Observers can connect before the robots, so that they miss nothing.
        observers = stack.enter_context(
            open_session(listen=[config.observe], guard=guard_server_for_observers(config.security, keys))
        )
        robots = {
            name: stack.enter_context(
                open_session(listen=[endpoint], guard=guard_server_for_robot(config.security, keys, name))
            )
            for name, endpoint in config.robots.items()
        }
        server = Server(config, robots, observers)
        server.run()
        server.linger(GRACE)


def main() -> NoReturn:
    """Run the server whose configuration is read from stdin."""
    supervised_main(ServerConfig, run_server)


if __name__ == "__main__":
    main()
