"""Identification of a cart from a recording of pushes."""

from functools import partial

import msgspec
import numpy as np

from coheft.app.cart.explain import Hand, explanation
from coheft.errors import RecordingError, UsageError
from coheft.estimation.cart.contact import grasp_map
from coheft.estimation.cart.filter import MOTION_SIZE, MotionMeasurement, Push
from coheft.estimation.cart.learner import CartLearner
from coheft.estimation.cart.model import CartBody
from coheft.estimation.cart.observability import QUANTITIES, UNITS, not_known
from coheft.estimation.cart.prior import CartPrior
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.recording import CartRecording

_PRIOR = CartPrior(mass=1.0, com=0.3, inertia=2.0, friction=(4.0, 4.0))
"""Guesses of users' carts are worse than those of the paper's tests."""
_BOX = (1.0**2 + 0.6**2) / 12.0
"""Squared radius of gyration of a box of 1 m by 0.6 m [m²]."""
_FRICTION = (5.0, 5.0)
_ARM = 0.1
"""Ratio of the torque's noise to the force's [m]."""
_WAY = 0.5
"""Time over which poses are compared with rates [s]."""
_ASIDE, _AHEAD, _SURELY = 0.01, 0.02, 6.0
"""Least error of the heading [rad] and of the axle's place [m] that are told, and their significance [std]."""
_SAME = 0.3
"""Largest difference between them, as a share of the motion."""
_OTHER_PACE, _BETTER = 0.02, 2.0
"""Relative difference of times that is told, and by how much the right ones have to fit better."""
_LITTLE = 0.03
"""Motions below this are not compared [m, rad]."""

_CHECK = "check units (N, N·m, m, rad), axes and signs of pushes and poses, and --hand"


class Quantity(msgspec.Struct, frozen=True):
    """An identified quantity with its standard deviation; ``not_known`` is what would show it, empty if it is known."""

    value: float
    std: float
    unit: str
    not_known: str


class CartIdentification(msgspec.Struct, frozen=True):
    """The cart at the end of a recording, and times of its sudden changes [s].

    Doubts are sentences about what is measured worse than stated.
    """

    samples: int
    duration_s: float
    quantities: dict[str, Quantity]
    changes_s: list[float]
    doubts: list[str]

    @property
    def is_known(self) -> bool:
        """Whether all quantities are known, and measurements are as good as stated."""
        return not self.doubts and not any(quantity.not_known for quantity in self.quantities.values())


def identify_cart(
    recording: CartRecording,
    *,
    mass: float,
    com: tuple[float, float],
    hand: Hand,
    noise: float,
    force_noise: float,
) -> CartIdentification:
    """Run the learner over a recording; if this does not fit, say what would.

    Mass [kg] and centre of mass [m] are first guesses; the hand is the point on the cart at which pushes are measured
    [m]. Noise is the standard deviation of poses and rates [m, rad, m/s, rad/s], and of forces [N].

    Raises:
        RecordingError: Poses, rates and pushes are not those of one cart.
        UsageError: An argument is not finite.
    """
    given = {"--mass": mass, "--com": com, "--hand": hand, "--noise": noise, "--force-noise": force_noise}
    for option, value in given.items():
        if not np.all(np.isfinite(np.asarray(value))):
            raise UsageError(f"{option}: found {value}, expected finite numbers")
    guess = CartBody(mass, com, mass * _BOX, _FRICTION)
    run = partial(_identified, guess=guess, noise=noise, force_noise=force_noise)

    def is_known(given: CartRecording, point: Hand) -> bool:
        return run(given, point).is_known

    _check_motion(recording)
    _check_axle(recording, noise)
    try:
        found = run(recording, hand)
    except RecordingError as error:
        other = explanation(recording, hand, is_known)
        raise RecordingError(f"{error}; {other}" if other else str(error)) from error
    is_contradicted = bool(found.changes_s) or any("unknown force" in doubt for doubt in found.doubts)
    if found.is_known or not is_contradicted:
        return found
    other = explanation(recording, hand, is_known) or f"no other meaning that was tried fits: {_CHECK}"
    return msgspec.structs.replace(found, doubts=[*found.doubts, other])


def _identified(
    recording: CartRecording, hand: Hand, *, guess: CartBody, noise: float, force_noise: float
) -> CartIdentification:
    """Run the learner once; arguments and errors as of ``identify_cart``."""
    grasp, lever = grasp_map(np.array(hand)), np.diag([1.0, 1.0, _ARM**2])
    pushes = recording.pushes @ grasp.T
    _check_pushes(recording, pushes)
    planned = pushes if recording.planned is None else recording.planned @ grasp.T
    motions = np.hstack([recording.poses, recording.rates])
    covariance = noise**2 * np.eye(MOTION_SIZE)
    prior = msgspec.structs.replace(_PRIOR, start=max(_PRIOR.start, float(np.linalg.norm(recording.rates[0]))))
    learner = CartLearner(guess, MotionMeasurement(motions[0], covariance), prior)
    changes: list[float] = []
    for index, duration in enumerate(np.diff(recording.times)):
        push = Push(pushes[index], force_noise**2 * grasp @ lever @ grasp.T, float(duration), planned[index])
        known, time = learner.jumps, float(recording.times[index])
        try:
            with np.errstate(over="raise", invalid="raise"):
                learner.step(MotionMeasurement(motions[index], covariance), push)
        except (ArithmeticError, ValueError) as error:
            raise RecordingError(
                f"from {time:g} s on, no cart with one axle moves as this one does when it is pushed as given: {_CHECK}"
            ) from error
        changes += [time] * (learner.jumps - known)
    deviations = np.sqrt(np.diag(learner.body_covariance()))
    unknown = not_known(learner.body_covariance(), is_judged=learner.is_judged)
    body = learner.body
    values = (body.mass, *body.com, body.inertia, *body.friction)
    return CartIdentification(
        samples=len(recording.times),
        duration_s=float(recording.times[-1] - recording.times[0]),
        quantities={
            name: Quantity(float(value), float(deviation), unit, unknown.get(name, ""))
            for name, value, deviation, unit in zip(QUANTITIES, values, deviations, UNITS, strict=True)
        },
        changes_s=changes,
        doubts=learner.doubts(),
    )


def _check_motion(recording: CartRecording) -> None:
    """Check that rates are those of poses."""
    times, poses, rates = recording.times, recording.poses, recording.rates
    given = _misfits(times, poses, rates)
    if not given:
        return  # it stands still
    if max(given) < _SAME:
        factor = _pace(times, poses, rates)
        better = min(_misfits(factor * times, poses, rates), default=0.0)
        if abs(factor - 1.0) > _OTHER_PACE and _BETTER * better < min(given):
            raise RecordingError(
                f"poses change {factor:.3g} times as much as rates say: times, or the rates, are in another unit"
            )
        return
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turned = np.column_stack([c * rates[:, 0] - s * rates[:, 1], s * rates[:, 0] + c * rates[:, 1], rates[:, 2]])
    radians = np.array([1.0, 1.0, np.pi / 180.0])
    meters = np.array([1e-3, 1e-3, 1.0])
    explanations = {
        "they would fit if rates were in the cart's axes: turn vx, vy into the floor's": (poses, turned),
        "they would fit if theta were in degrees: give it in radians": (poses * radians, rates),
        "they would fit if omega were in degrees per second: give it in rad/s": (poses, rates * radians),
        "they would fit if theta and omega were in degrees: give them in radians": (poses * radians, rates * radians),
        "they would fit if x and y, or vx and vy, were exchanged": (poses[:, [1, 0, 2]], rates),
        "they would fit if x, y were in millimetres: give them in metres": (poses * meters, rates),
    }
    shares = {words: _misfits(times, *each) for words, each in explanations.items()}
    misfits = {words: max(each) if len(each) == len(given) else np.inf for words, each in shares.items()}
    best = min(misfits, key=lambda words: misfits[words])
    reason = best if misfits[best] < _SAME else "check units, axes, and that both have the same clock"
    raise RecordingError(
        f"rates are not those of poses: over {_WAY:g} s they differ by {100 * max(given):.0f} % of the motion; {reason}"
    )


def _pace(times: Array, poses: Array, rates: Array) -> float:
    """How far the cart goes by its poses, in multiples of what rates say; 1 if it hardly goes anywhere."""
    moved, said = (changes[:, :2] for changes in _changes(times, poses, rates))
    return float(np.sum(moved * said) / np.sum(said**2)) if _rms(said) > _LITTLE else 1.0


def _check_axle(recording: CartRecording, noise: float) -> None:
    """Check that the axle does not move sideways."""
    ahead, aside = _in_cart(recording.poses, recording.rates)
    motions = np.column_stack([ahead, recording.rates[:, 2]])
    information = motions.T @ motions
    if np.linalg.matrix_rank(information) < len(information):
        return
    heading, place = np.linalg.solve(information, motions.T @ aside)
    slip, left = _rms(aside), _rms(aside - motions @ [heading, place])
    least = _SURELY * max(noise, left) * np.sqrt(np.diag(np.linalg.inv(information)))
    found = []
    if abs(heading) > max(_ASIDE, least[0]):
        found.append(f"theta is off by {np.degrees(heading):.2g}°: x has to point ahead")
    if abs(place) > max(_AHEAD, least[1]):
        where = "ahead of" if place > 0.0 else "behind"
        found.append(f"the pose is that of a point {abs(place):.2g} m {where} the axle: give that of its middle")
    if found:
        if abs(heading) > _SAME or left > max(_SAME * slip, 3.0 * noise):
            found = ["are x, y in metres, and theta in radians, from the floor's x to the cart's, growing to the left?"]
        raise RecordingError(f"the axle's wheels would slip sideways, at {slip:.2g} m/s; {'; '.join(found)}")


def _in_cart(poses: Array, rates: Array) -> tuple[Array, Array]:
    """Velocities ahead and to the left in the cart's axes, shape (n,) each [m/s]."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return c * rates[:, 0] + s * rates[:, 1], c * rates[:, 1] - s * rates[:, 0]


def _misfits(times: Array, poses: Array, rates: Array) -> list[float]:
    """Root mean square differences between changes of poses and integrals of rates, as shares of the motion.

    Of translations and of rotations, but not of those that are too small.
    """
    moved, said = _changes(times, poses, rates)
    shares = []
    for part in (slice(0, 2), slice(2, 3)):
        size = max(_rms(moved[:, part]), _rms(said[:, part]))
        if size > _LITTLE:
            shares.append(_rms(moved[:, part] - said[:, part]) / size)
    return shares


def _changes(times: Array, poses: Array, rates: Array) -> tuple[Array, Array]:
    """Changes of poses over ``_WAY``, and those that rates say, shape (k, 3) each."""
    steps = np.diff(times)[:, None]
    integral = np.vstack([np.zeros((1, 3)), np.cumsum(0.5 * (rates[1:] + rates[:-1]) * steps, axis=0)])
    ahead = max(1, round(_WAY / float(np.median(steps))))
    return poses[ahead:] - poses[:-ahead], integral[ahead:] - integral[:-ahead]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _check_pushes(recording: CartRecording, pushes: Array) -> None:
    """Check that the cart goes where it is pushed."""
    speeds, _ = _in_cart(recording.poses, recording.rates)
    if np.abs(speeds).max() < _PRIOR.slow:
        raise RecordingError(
            f"the cart is never faster than {np.abs(speeds).max():.2g} m/s, expected more than {_PRIOR.slow:g} m/s: "
            f"push it farther"
        )
    work = float(np.sum(pushes[:, 0] * speeds))
    if work < 0.0:
        raise RecordingError(
            "the cart goes against the push ahead all in all, expected along: if fx is what the cart does to the hand, "
            "turn the signs of fx, fy, mz"
        )
