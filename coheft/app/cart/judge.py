"""Errors of a run with a cart."""

from collections.abc import Sequence

import msgspec
import numpy as np

from coheft.app.cart.inprocess import CartRun
from coheft.estimation.cart.observability import QUANTITIES
from coheft.estimation.cart.trajectory import TRAJECTORIES
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.messages import CartEstimate
from coheft.wire.cart.scenario import CartLoad

MASS_AT = 10.0
"""Time at which the mass is judged [s]: the paper says that it has converged by then."""
SETTLED = 5.0
"""Time from which on tracking is judged [s]."""
RECOVERED = 0.5
"""Mass error below which a pusher has recovered from a load change [kg]."""
_LOST = 1.0
"""Errors at the end above which a run has diverged [kg, and m off the path]."""


class LoadRecovery(msgspec.Struct, frozen=True):
    """Recovery from a change of the load.

    Attributes:
        at_s: Time of the change [s].
        mass_kg: Mass that was added.
        recovered_after_s: Time until every pusher's mass was within 0.5 kg, and stayed so until the next change [s];
            None if it did not, or if no estimate of a pusher was received meanwhile.
    """

    at_s: float
    mass_kg: float
    recovered_after_s: float | None


class CartReport(msgspec.Struct, frozen=True):
    """Errors of one run; the worst of several pushers.

    Attributes:
        test: Number in Table I.
        mass_error_kg: Mass error at 10 s.
        mass_std_kg: The pusher's standard deviation of it.
        com_error_mm: Error of the centre of mass at the end.
        com_known: Whether the pushers report the centre of mass as known.
        com_std_mm: Their standard deviation of it: root of the sum of both variances.
        inertia_error_kg_m2: Error of the central moment of inertia at the end.
        largest_tracking_error_m: Largest distance from the reference after 5 s.
        first_tracking_error_m: Largest distance from the reference before.
        mean_effort_n: Mean effort of all hands, see ``CartTruth``.
        slip_m_s: Largest sideways velocity of the wheels.
        doubts: What the pushers report as measured worse than stated.
        diverged: Whether the estimate or the cart is lost at the end.
    """

    test: int
    seed: int
    pushers: int
    learns: bool
    mass_error_kg: float
    mass_std_kg: float
    com_error_mm: float
    com_known: bool
    com_std_mm: float
    inertia_error_kg_m2: float
    not_known: list[str]
    largest_tracking_error_m: float
    first_tracking_error_m: float
    mean_effort_n: float
    slip_m_s: float
    jumps: int
    doubts: list[str]
    loads: list[LoadRecovery]
    diverged: bool


def tracking_errors(run: CartRun) -> tuple[Array, Array]:
    """Times [s] and distances from the reference [m], each of shape (samples,)."""
    trajectory = TRAJECTORIES[run.scenario.trajectory]
    errors = [np.hypot(*(truth.motion[:2] - trajectory.at(truth.time).pose[:2])) for truth in run.truths]
    return np.array([truth.time for truth in run.truths]), np.array(errors)


def mass_errors(run: CartRun, name: str) -> tuple[Array, Array]:
    """Times [s] and mass errors [kg] of a pusher, each of shape (estimates,)."""
    by_block = {truth.block: truth for truth in run.truths}
    known = [estimate for estimate in run.estimates[name] if estimate.block in by_block]
    errors = [estimate.cart.mass - by_block[estimate.block].cart.mass for estimate in known]
    return np.array([estimate.time for estimate in known]), np.array(errors)


def judge(run: CartRun, test: int) -> CartReport:
    """Compute the errors of a complete run; ``test`` is its number in Table I."""
    last = {name: estimates[-1] for name, estimates in run.estimates.items()}
    truth = run.truths[-1].cart
    com_errors = {name: float(np.hypot(*np.subtract(e.cart.com, truth.com))) for name, e in last.items()}
    worst = last[max(com_errors, key=lambda name: com_errors[name])]
    at_time = {name: _newest(estimates, MASS_AT) for name, estimates in run.estimates.items()}
    mass_then = max((each for each in run.truths if each.time <= MASS_AT), key=lambda each: each.time).cart.mass
    farthest = max(at_time.values(), key=lambda estimate: abs(estimate.cart.mass - mass_then))
    times, errors = tracking_errors(run)
    com = slice(QUANTITIES.index("d_x"), QUANTITIES.index("d_y") + 1)
    last_mass_error = max(abs(estimate.cart.mass - truth.mass) for estimate in last.values())
    return CartReport(
        test=test,
        seed=run.scenario.seed,
        pushers=run.scenario.pushers,
        learns=run.scenario.learns,
        mass_error_kg=farthest.cart.mass - mass_then,
        mass_std_kg=float(np.sqrt(farthest.covariance[0, 0])),
        com_error_mm=1e3 * max(com_errors.values()),
        com_known=not {"d_x", "d_y"} & worst.not_known.keys(),
        com_std_mm=1e3 * float(np.sqrt(np.trace(worst.covariance[com, com]))),
        inertia_error_kg_m2=worst.cart.inertia - truth.inertia,
        not_known=sorted(worst.not_known),
        largest_tracking_error_m=float(errors[times >= SETTLED].max()),
        first_tracking_error_m=float(errors[times < SETTLED].max()),
        mean_effort_n=float(np.mean([truth.effort for truth in run.truths])),
        slip_m_s=max(abs(truth.slip) for truth in run.truths),
        jumps=max(estimate.jumps for estimate in last.values()),
        doubts=worst.doubts,
        loads=_recoveries(run),
        diverged=run.scenario.learns and not (last_mass_error < _LOST and errors[-1] < _LOST),
    )


def _newest(estimates: Sequence[CartEstimate], time: float) -> CartEstimate:
    """The newest estimate at a time [s], or else the first one."""
    return max((e for e in estimates if e.time <= time), key=lambda e: e.time, default=estimates[0])


def _recoveries(run: CartRun) -> list[LoadRecovery]:
    loads: list[CartLoad] = sorted(run.scenario.loads, key=lambda load: load.at)
    ends = [load.at for load in loads[1:]] + [run.scenario.duration] * bool(loads)
    return [
        LoadRecovery(load.at, load.mass, _recovered_after(run, load.at, end))
        for load, end in zip(loads, ends, strict=True)
    ]


def _recovered_after(run: CartRun, begin: float, end: float) -> float | None:
    """Time from ``begin`` until all masses were right, and stayed so until ``end`` [s]; None if they did not."""
    longest = 0.0
    for name in run.estimates:
        times, errors = mass_errors(run, name)
        during = (times >= begin) & (times < end)
        wrong = np.abs(errors[during]) > RECOVERED
        if not wrong.size or wrong[-1]:
            return None
        since = times[during][np.flatnonzero(wrong)[-1] + 1] if wrong.any() else begin
        longest = max(longest, float(since) - begin)
    return longest
