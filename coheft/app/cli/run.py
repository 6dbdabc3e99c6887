"""The command that starts a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from coheft.app.cli import options
from coheft.app.cli.base import EXIT_CONVERGED, EXIT_INTERRUPTED, EXIT_NOT_CONVERGED, RUN, app
from coheft.app.cli.errors import complain
from coheft.errors import CoheftError, UsageError
from coheft.wire.process.log import LogLevel

if TYPE_CHECKING:  # loaded only by runs that need them
    from rich.console import Console

    from coheft.app.recording.recorder import Recorder
    from coheft.app.run.broken_off import BrokenOff
    from coheft.app.run.hosts import Hosts
    from coheft.app.run.plan import Plan
    from coheft.app.view.place import Place
    from coheft.app.view.process import ViewBeside
    from coheft.wire.config import ClockKind
    from coheft.wire.scenario.schema import Scenario

_SCENARIO, _OUTPUT, _VIEW, _PROCESSES = (
    Parameter(group=Group.create_ordered(name)) for name in ("Scenario", "Output", "View", "Processes")
)


@app.command(group=RUN)
def run(
    scenario: Annotated[options.ScenarioName, _SCENARIO] = "ring6",
    *,
    change: Annotated[list[str] | None, Parameter(negative=()), _SCENARIO] = None,
    set: Annotated[list[str] | None, Parameter(negative=()), _SCENARIO] = None,
    duration: Annotated[float | None, _SCENARIO] = None,
    seed: Annotated[options.Whole | None, _SCENARIO] = None,
    estimator: Annotated[str | None, _SCENARIO] = None,
    sensor_rate: Annotated[options.Whole | None, _SCENARIO] = None,
    realtime: Annotated[options.Flag, _PROCESSES] = False,
    restarts: Annotated[options.NotNegative, _PROCESSES] = 3,
    json: Annotated[options.ReportTarget, _OUTPUT] = None,
    history: Annotated[options.Flag, _OUTPUT] = False,
    report: Annotated[options.FolderTarget, _OUTPUT] = None,
    quiet: Annotated[options.Flag, _OUTPUT] = False,
    save_data: Annotated[options.DataTarget, _OUTPUT] = None,
    record: Annotated[options.RecordingTarget, _OUTPUT] = None,
    view: Annotated[options.Flag, _VIEW] = False,
    view_read_only: Annotated[options.Flag, _VIEW] = False,
    no_wait: Annotated[options.Flag, _VIEW] = False,
    logs: Annotated[options.FolderTarget, _PROCESSES] = None,
    log_level: Annotated[LogLevel, _PROCESSES] = "info",
    secure: Annotated[options.Flag, _PROCESSES] = False,
    keys: Annotated[options.GivenPath | None, _PROCESSES] = None,
    hosts: Annotated[options.GivenPath | None, _PROCESSES] = None,
    write_configs: Annotated[options.FolderTarget, _PROCESSES] = None,
    feedforward: Annotated[bool | None, _SCENARIO] = None,
) -> int:
    """Start the physics server and one process per robot, and follow their estimates of the load.

    Ctrl-C ends the run early, with all results so far; a second Ctrl-C ends it at once, without them.

    Exit status 0 if every robot converged, none is stale, and no error is larger than four of the robot's own standard
    deviations; otherwise 3.

    Args:
        change: A change of the load that replaces those of the scenario. For instance, t=20,mass=3,at=0.4,0.3,0.1 drops
            3 kg at 20 s, at this position in the payload's frame [m]. size=0.2,0.2,0.1 gives its edge lengths [m], and
            leak=0.1 the mass it loses from then on [kg/s]. t=30,remove=1 takes the first load away. May be repeated.
        set: Set a key of the scenario, in TOML syntax, for instance sensors.noise_scale=3 or load_changes[0].at=8;
            docs/scenarios.md lists all keys. May be repeated; other options take precedence.
        duration: Simulated time [s]. With --view and no duration, the run continues until you stop it.
        seed: Seed of the sensors' noise and the robots' motions.
        estimator: Estimator that all robots use: efficient, fan2017, or your own, see docs/own.md. With several, as in
            efficient,fan2017, each robot runs them side by side on the same samples.
        sensor_rate: Samples per second: 100, 125, 200, 250, 500 or 1000.
        realtime: Keep pace with wall-clock time and wait for no robot, instead of running as fast as the slowest robot
            allows.
        restarts: How often an agent that dies is restarted before the run ends with an error.
        history: Add the errors of every second to the report.
        report: Folder for an HTML page, its pictures and their data; needs coheft[report].
        quiet: Print only errors, and the address of the view.
        save_data: Save the measurements of all robots for 'coheft identify': to an .npz file or, without a suffix, a
            folder of CSV files.
        record: Record the run to this new .mcap file, for 'coheft view', Foxglove and PlotJuggler, see
            docs/recording.md.
        view: Show the run in the browser, no faster than wall-clock time. It continues until you stop it; with
            --duration, --record or --save-data it ends as usual. The last scene stays until Ctrl-C. See docs/view.md.
        view_read_only: The same, read-only: without buttons.
        no_wait: Start at once, without waiting for a browser to open the view.
        logs: Folder for the processes' logs, which must not contain any yet; by default a new folder among your runs.
        log_level: Lowest level that is logged: debug, info, warning or error.
        secure: Encrypt and authenticate all links with certificates made for this run.
        keys: Folder of certificates made by 'coheft keys', to use instead of new ones for this run.
        hosts: File that names the host of each part, see docs/deployment.md; needs --write-configs.
        write_configs: Do not run. Write the configurations of all processes into this folder, to start them by hand.
        feedforward: In scenarios where robots carry the load along a path: whether they use feed-forward forces from
            their estimates.
    """
    from coheft.app.run.processes import make_fork_server

    fork_server = make_fork_server() if write_configs is None else None  # it imports in the background

    from rich.console import Console

    from coheft.app.run.hosts import LOOPBACK, load_hosts
    from coheft.app.run.overrides import override
    from coheft.app.run.plan import check_no_parts, make_plan, new_run_name
    from coheft.wire.scenario.file import load_scenario, scenario_path
    from coheft.wire.scenario.schema import MAX_DURATION

    view = view or view_read_only
    has_end = duration is not None or any(value.partition("=")[0].strip() == "duration" for value in set or ())
    if view and not (has_end or record or save_data or write_configs):
        duration = MAX_DURATION
    chosen = override(
        load_scenario(scenario, set or ()),
        changes=change or (),
        duration=duration,
        seed=seed,
        estimator=estimator,
        sensor_rate=sensor_rate,
        feedforward=feedforward,
    )
    if no_wait and not view:
        raise UsageError("--no-wait needs a view: add --view")
    of_a_run = {"view": view, "record": record, "json": json, "report": report, "history": history, "logs": logs}
    unusable = [option for option, value in of_a_run.items() if value and write_configs is not None]
    if unusable:
        raise UsageError(f"--{unusable[0]} needs a run, but --write-configs makes none")
    if hosts is not None and write_configs is None:
        raise UsageError("--hosts needs --write-configs, so that each part can be started on its own host")
    if history and json is None and report is None:
        raise UsageError("--history adds to the report, but none was requested: add --json FILE or --report DIR")
    options.check_outputs(scenario_path(scenario), json=json, report=report, save_data=save_data, record=record)
    if keys is not None and not keys.is_dir():
        raise UsageError(f"--keys: there is no folder {str(keys)!r}; 'coheft keys' makes one")
    places = load_hosts(hosts, chosen) if hosts is not None else None
    clock: ClockKind = "realtime" if realtime else "paced" if view else "lockstep"

    def planned(name: str, folder: Path) -> Plan:
        """Return the plan of a run, with certificates in its folder if it needs new ones."""
        run_keys = _credentials(keys, folder, chosen, places) if secure or keys is not None else None
        return make_plan(chosen, clock, run=name, hosts=places, keys=run_keys, save_data=save_data, log_level=log_level)

    if write_configs is not None:
        check_no_parts(write_configs, chosen)
        for path in planned(new_run_name(), write_configs).write(write_configs):
            print(f"coheft {'server' if path.stem == 'server' else 'agent'} {path}")
        return EXIT_CONVERGED

    from contextlib import ExitStack

    from coheft.app.figures import picture_folder
    from coheft.app.outputs import write_outputs
    from coheft.app.results.report import write_report
    from coheft.app.run.broken_off import BrokenOff
    from coheft.app.run.ctrl_c import FirstCtrlC
    from coheft.app.run.folder import make_run_folder
    from coheft.app.run.launch import launch
    from coheft.app.run_report.series import SeriesFollower
    from coheft.app.terminal.final_table import print_report
    from coheft.app.terminal.notes import print_notes
    from coheft.app.terminal.screen import make_display
    from coheft.wire.process.memory import give_back_memory

    always, console = Console(stderr=json == "-"), Console(stderr=json == "-", quiet=quiet)

    offers_another = view and not any((json, report, record, save_data, logs))
    place: Place | None = None
    if view:
        from coheft.app.view.place import Place

        place = Place.choose(LOOPBACK)

    def once(*, is_another: bool) -> tuple[int, bool]:
        """Run once; return the exit status, and whether the user of the view has requested another run."""
        name = new_run_name()
        wants_another = False
        with ExitStack() as stack:
            stack.enter_context(picture_folder(report, "report"))
            page = SeriesFollower() if report is not None else None
            folder = make_run_folder(name, logs)
            plan = planned(name, folder)
            give_back_memory()
            viewer: ViewBeside | None = None
            if place is not None:
                from coheft.app.view.process import ViewBeside, ViewConfig

                viewer = ViewBeside(ViewConfig(str(folder), place, view_read_only, offers_another))
                stack.enter_context(viewer)
                _wait_for_view(always, viewer, place, waits=not (no_wait or is_another))
            print_notes(console, chosen)
            recorder: Recorder | None = None
            if record is not None:
                from coheft.app.recording.recorder import Recorder

                recorder = stack.enter_context(Recorder(record, chosen))
            asked = {"json": json, "report": report, "save_data": save_data, "record": record}
            broken_off, ctrl_c = BrokenOff(asked, folder, recorder), stack.enter_context(FirstCtrlC())
            try:
                found = launch(
                    plan,
                    folder,
                    make_display(console),
                    followers=[each for each in (page, recorder, broken_off) if each is not None],
                    with_history=history,
                    restarts=restarts,
                    fork_server=None if is_another else fork_server,
                    ctrl_c=ctrl_c,
                )
            except KeyboardInterrupt as interruption:
                raise KeyboardInterrupt(broken_off.sentence(str(interruption))) from None
            except CoheftError as error:
                error.args = (f"{error}{broken_off.after_error()}",)
                raise
            print_report(console, found, folder)

            def write_json(target: str) -> None:
                write_report(found, target)
                _tell(console, "JSON report", target)

            def write_page(folder: Path) -> None:
                from coheft.app.run_report.folder import write_folder

                assert page is not None
                _tell(console, "Report", write_folder(folder, chosen, clock, page.series, found))

            try:
                write_outputs((json, write_json), (report, write_page))
            except (CoheftError, OSError):
                for text in _lost(broken_off, recorder):
                    complain(text)
                raise
            ctrl_c.end()
            if not broken_off.unsaved:
                _tell(console, "Data", save_data)
            is_over = viewer is None or ctrl_c.is_pressed  # the view ends with a run that Ctrl-C has ended
            if viewer is not None and place is not None and viewer.is_there and not is_over:
                _tell(console, "The view stays until Ctrl-C", place.url)
                wants_another = viewer.wait_for_another()
            elif viewer is not None and not is_over:
                _tell(always, "The view has ended before the run; its log", viewer.log)
        if recorder is not None and not recorder.problem:
            _tell(console, "Recording", record)
        if lost := _lost(broken_off, recorder):
            raise CoheftError("\n".join(lost))
        if ctrl_c.is_pressed:
            return EXIT_INTERRUPTED, False
        return EXIT_CONVERGED if found.converged else EXIT_NOT_CONVERGED, wants_another

    status, wants_another = once(is_another=False)
    while wants_another:
        status, wants_another = once(is_another=True)
    return status


def _lost(broken_off: BrokenOff, recorder: Recorder | None) -> list[str]:
    """Return messages about outputs of a finished run, apart from reports, that could not be written."""
    unsaved = f"no data file was written: {broken_off.unsaved}" if broken_off.unsaved else ""
    return [text for text in (unsaved, "" if recorder is None else recorder.problem) if text]


def _tell(console: Console, what: str, place: str | Path | None) -> None:
    """Print where an output is, unless it is on standard output."""
    if place is not None and place != "-":
        console.print(f"{what}: {place}", markup=False, highlight=False, soft_wrap=True)


def _credentials(keys: Path | None, folder: Path, scenario: Scenario, places: Hosts | None) -> Path:
    """Return the folder with all participants' certificates: a given one, or a new one for this run."""
    from coheft.app.run.keys import check_keys, make_keys

    if keys is None:
        keys = folder / "keys"
        make_keys(keys, scenario, places, keeps_authority=False)
    check_keys(keys, scenario, places)
    return keys


def _wait_for_view(console: Console, viewer: ViewBeside, place: Place, *, waits: bool) -> None:
    """Print the address of the view as soon as it is ready, before anything else, and wait until it is opened."""
    from coheft.app.view.process import READY, SEEN

    viewer.wait_for(READY)
    console.print(f"The view is at {place.url}", markup=False, highlight=False, soft_wrap=True)
    if waits:
        console.print("The run begins when a browser has opened it; with --no-wait, at once.", highlight=False)
        viewer.wait_for(SEEN)
