"""The command that pushes a cart."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter
from cyclopts.validators import Number

from coheft.app.cli import options
from coheft.app.cli.base import EVALUATE, EXIT_CONVERGED, EXIT_NOT_CONVERGED, app
from coheft.errors import UsageError

Point = Annotated[tuple[float, float], Parameter(negative=(), show_default=lambda point: " ".join(map(str, point)))]

cart_app = cyclopts.App(name="cart", group=EVALUATE, group_commands="Your own recordings")
app.command(cart_app)


@cart_app.default
def cart(
    *,
    test: Annotated[options.Whole | None, Parameter(validator=Number(gte=1, lte=12))] = None,
    all_tests: Annotated[bool, Parameter(name="--all", negative=(), show_default=False)] = False,
    seeds: options.Count = 1,
    first_seed: options.NotNegative = 1,
    pushers: options.Count = 1,
    friction_guess: options.Positive | None = None,
    turning_friction: options.Positive = 1.0,
    noise_factor: options.Positive = 1.0,
    processes: options.Flag = False,
    jobs: options.Count | None = None,
    json: options.ReportTarget = None,
    figures: options.FolderTarget = None,
    quiet: options.Quiet = False,
) -> int:
    """Push a cart of unknown mass along a trajectory, with and without identifying it.

    Repeats the simulations of Aguilera et al., "Modeling and Inertial Parameter Estimation of Cart-like Nonholonomic
    Systems Using a Mobile Manipulator", Table I, and compares the results. Exit status 3 if a result is worse than it
    should be.

    Args:
        test: Number of a test in Table I, 1 to 11; or 12, a test of our own: push and pull, with casters that turn
            around.
        all_tests: Run all tests, which is also the default.
        seeds: Runs of each test; the comparison without the estimator is run once.
        first_seed: Seed of the first run's noise; the others follow consecutively.
        pushers: Number of robots that push side by side; each knows only its own wrench.
        friction_guess: The translational friction that the pushers assume, relative to the true one, for instance 0.5
            or 2; by default they know it. They never know the turning friction.
        turning_friction: Turning friction relative to translational friction; the pushers assume that both are equal.
        noise_factor: Factor by which the noise of the motion is larger than the pushers assume.
        processes: One process per pusher and one for the cart, linked by Zenoh, instead of all in this one.
        jobs: Number of parallel runs; by default one per core. More than one needs coheft[study]. Not with --processes.
        figures: Folder for those of the paper's figures 4 to 6 that show the chosen tests; needs coheft[study].
    """
    from rich.console import Console

    from coheft.app.cart.campaign import Case, Outcome, Run, run_cases
    from coheft.app.cart.figures import draw
    from coheft.app.cart.inprocess import run_in_process
    from coheft.app.cart.launch import run_in_processes
    from coheft.app.cart.table import CartStudy, missed
    from coheft.app.cart.table_one import TESTS, table_one
    from coheft.app.cart.terminal import print_study
    from coheft.app.figures import picture_folder
    from coheft.app.outputs import write_outputs
    from coheft.app.results.report import write_report
    from coheft.app.run.parallel import usual_jobs
    from coheft.app.terminal.progress import show_progress

    if all_tests and test is not None:
        raise UsageError(f"--all runs all tests of Table I, --test {test} only one: leave one of the two out")
    if processes and jobs is not None:
        raise UsageError("--jobs is for runs side by side, but with --processes they come one after the other")
    options.check_outputs(json=json, figures=figures)
    chosen = TESTS if all_tests or test is None else (test,)
    of_test = partial(
        table_one, friction_guess=friction_guess, turning_friction=turning_friction, noise_factor=noise_factor
    )
    chosen_seeds = range(first_seed, first_seed + seeds)
    cases = [Case(number, of_test(number, seed=seed, pushers=pushers)) for number in chosen for seed in chosen_seeds]
    cases += [Case(number, of_test(number, seed=first_seed, learns=False)) for number in chosen]
    console = Console(stderr=json == "-", quiet=quiet)
    run: Run = run_in_process
    if processes:
        run = partial(run_in_processes, make_folder=log_folders(), on_problem=Console(stderr=json == "-").print)
    found: dict[Case, Outcome] = {}
    with picture_folder(figures), show_progress(console, "runs", len(cases)) as progress:
        for outcome in run_cases(cases, 1 if processes else jobs or min(len(cases), usual_jobs()), run):
            found[outcome.case] = outcome
            progress()
    outcomes = [found[case] for case in cases]
    reports = [outcome.report for outcome in outcomes]
    study = CartStudy(reports, missed(reports))
    print_study(console, study)

    def draw_into(folder: Path) -> None:
        for path in draw(outcomes, folder):
            console.print(f"Figure: {path}", markup=False, highlight=False, soft_wrap=True)

    write_outputs((json, partial(write_report, study)), (figures, draw_into))
    return EXIT_NOT_CONVERGED if study.missed else EXIT_CONVERGED


@cart_app.command
def identify(
    recording: options.GivenPath,
    *,
    mass: options.Positive = 20.0,
    com: Point = (0.3, 0.0),
    hand: Point = (0.0, 0.0),
    noise: options.Positive = 0.005,
    force_noise: options.NotNegativeNumber = 0.0,
    json: options.ReportTarget = None,
    quiet: options.Quiet = False,
) -> int:
    """Identify a cart from your own recording: mass, centre of mass, inertia and friction.

    Exit status 0 if everything is known at the end and the measurements fit; otherwise 3, and the report says what is
    missing.

    Args:
        recording: A .csv or .npz file with times, poses, rates and pushes, see docs/cart.md.
        mass: First guess of the mass, within a factor of four [kg].
        com: First guess of the centre of mass: ahead of the axle's middle, and to the left of it [m].
        hand: Point at which the push is measured, in the same coordinates; torques are about it [m].
        noise: Standard deviation of measured poses and rates, the same number in each of their units; noise that is
            larger is noticed.
        force_noise: Standard deviation of measured forces [N]; that of torques is a tenth of it [N·m].
    """
    from rich.console import Console

    from coheft.app.cart.identify import identify_cart
    from coheft.app.cart.terminal import print_identification
    from coheft.app.results.report import write_report
    from coheft.wire.cart.recording import read_cart_recording

    options.check_outputs(recording, json=json)
    found = identify_cart(
        read_cart_recording(recording), mass=mass, com=com, hand=hand, noise=noise, force_noise=force_noise
    )
    print_identification(Console(stderr=json == "-", quiet=quiet), found)
    if json is not None:
        write_report(found, json)
    return EXIT_CONVERGED if found.is_known else EXIT_NOT_CONVERGED


def log_folders() -> Callable[[str], Path]:
    """Return a function that makes the folder for the logs of a run; all are in the first one's, which counts as one
    run.
    """
    from coheft.app.run.folder import make_run_folder

    first: list[Path] = []

    def make_folder(run: str) -> Path:
        if not first:
            first.append(make_run_folder(run))
        return make_run_folder(run, first[0] / run)

    return make_folder
