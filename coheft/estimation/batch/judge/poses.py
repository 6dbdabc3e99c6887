"""Whether all robots' poses are those of one load at the same times; if not, which robot's are wrong.

According to robot i, the load's pose is ``B_i = H_i T_i X_i^-1``. Constant errors of homes ``H_i`` and grasps ``X_i``
are fitted; the remaining differences are noise, unless something is wrong. A grasp that slips has another pose in the
load from some time on: the robot's view of the load has a step.
"""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.inertia_fit import others
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.recording import CHANNELS
from coheft.estimation.batch.signals import Signals, body_motions
from coheft.estimation.geometry.body_motion import BODY_ALPHA, BODY_W
from coheft.estimation.geometry.spatial import Array, Pose

_SURE = 6.0
"""Standard deviations beyond which a difference is no chance."""
_STRETCHED = 5e-4
"""Relative difference of lengths that does not matter."""
_CALIBRATED = 0.2
"""Largest relative error of lengths that may be one of several calibration errors."""
_MOST = 0.9
"""Share of large differences that a wrong scale has to explain."""
_FINEST = 1e-6
"""Effect on poses that no sensor resolves, but rounding may have [m]."""
_LATE = 1e-3
"""Difference of clocks that does not matter [s]."""
_FROM_THE_EDGE = 1.0
"""Slips in the first and the last second are not looked for [s]."""
_LEFT = 0.1
"""Share of the squared differences that a slip may leave unexplained."""
_BATCH = 0.2
"""Time over which samples are averaged [s]."""
_STEPS, _STEP, _LONGEST, _FOUND = 12, 0.1, 1.0, 1e-4
"""Of Gauss-Newton [s]."""


class _Views:
    """Differences of N robots' views of the load from their mean, in b batches.

    Rotations and translations are in the load's axes, in units of their median change between batches, which is noise.

    Attributes:
        time: Times of the batches, shape (b,) [s].
        scale: Factors of rotations and translations, shape (6,).
        rest: Differences without constant errors of homes and grasps, shape (N, b, 6).
        basis: Orthonormal basis of the effects of such errors, shape (b, 6, q).
        positions: Positions of each grasp frame in its home frame, minus their mean, in the load's axes, (N, b, 3) [m].
    """

    def __init__(self, evidence: Evidence) -> None:
        poses, times = evidence.recording.stacked("pose"), evidence.recording.time
        length = max(1, round(_BATCH * (len(times) - 1) / (times[-1] - times[0])))
        batches = len(times) // length

        def mean(samples: Array) -> Array:
            result: Array = samples[: batches * length].reshape(batches, length, *samples.shape[1:]).mean(axis=1)
            return result

        seen = [_load(*each) for each in zip(poses, evidence.homes, evidence.poses, strict=True)]
        rotations, positions = seen[0]
        to_load = rotations.swapaxes(-1, -2)
        differences, places = [], []
        for (turned, moved), own, home in zip(seen, poses, evidence.homes, strict=True):
            turn = Rotation.from_matrix(to_load @ turned).as_rotvec()
            shift = (to_load @ (moved - positions)[..., None])[..., 0]
            differences.append(mean(np.hstack([turn, shift])))
            away = (own[:, :3] - own[:, :3].mean(axis=0)) @ home.rotation.T
            places.append(mean((to_load @ away[..., None])[..., 0]))
        views = np.array(differences)
        views -= views.mean(axis=0)
        of_home = mean(_from_home(rotations, positions))
        design = np.concatenate([np.broadcast_to(np.eye(6), of_home.shape), of_home], axis=-1)
        sizes = np.median(np.abs(np.diff(views, axis=1)).reshape(-1, 2, 3), axis=(0, 2))
        self.time, self.positions = mean(times), np.array(places)
        self.scale = np.repeat(1.0 / np.maximum(sizes, 1e-12), 3)
        basis = np.linalg.qr((design * self.scale[:, None]).reshape(batches * 6, -1))[0]
        flat = (views * self.scale).reshape(len(views), -1)
        self.rest = (flat - flat @ basis @ basis.T).reshape(views.shape)
        self.basis = basis.reshape(batches, 6, -1)


def _load(poses: Array, home: Pose, grasp: Pose) -> tuple[Array, Array]:
    """Orientations (n, 3, 3) and positions (n, 3) of the load according to one robot's poses (n, 7)."""
    to_load = grasp.inverse()
    own = home.rotation @ Rotation.from_quat(poses[:, 3:]).as_matrix()
    places = home.translation + poses[:, :3] @ home.rotation.T
    return own @ to_load.rotation, places + own @ to_load.translation


def _from_home(rotations: Array, positions: Array) -> Array:
    """Derivative of the load's pose, in its own axes, by a perturbation of the home frame in the world, (n, 6, 6)."""
    turned = rotations.swapaxes(-1, -2)
    result = np.zeros((len(positions), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = turned
    result[:, 3:, :3] = np.cross(turned, positions[:, None])
    return result


def judge_poses(evidence: Evidence) -> Verdict | None:
    """Find a clock that is late, a grasp that slipped, or a wrong scale of lengths; None if there is none."""
    late = _late(evidence)
    if late is not None or not evidence.homes:
        return late
    views = _Views(evidence)
    return _slip(evidence, views) or _stretched(evidence, views)


def _late(evidence: Evidence) -> Verdict | None:
    """Find a robot whose clock is not that of the others."""
    recording = evidence.recording
    delays, deviations = clock_delays(evidence.signals, evidence.poses)
    sure = np.where(np.abs(delays) > np.maximum(_SURE * deviations, _LATE), np.abs(delays), 0.0)
    if not sure.any():
        return None
    worst = int(np.argmax(sure))
    delay, std, culprit = float(delays[worst]), float(deviations[worst]), evidence.culprit(worst)
    what = "twists" if recording.has("twist") else "poses"
    either = "" if culprit else " (or those of the other robot, the other way round)"
    words = (
        f"{what} of {recording.names[worst]} are{either} {abs(1e3 * delay):.3g} ms "
        f"{'late' if delay > 0.0 else 'early'} against the others' (std {1e3 * std:.2g} ms), and perhaps its other "
        f"measurements, too: shift its samples in time"
    )
    channels = tuple(channel for channel in CHANNELS if recording.has(channel))
    return Verdict(Cause.CLOCK, culprit, (delay,), words, is_open=culprit is None, channels=channels)


def _slip(evidence: Evidence, views: _Views) -> Verdict | None:
    """Find the slip that explains nearly all differences between the robots' views of the load; None if none does."""
    time, count = views.time, len(views.rest)
    inner = np.flatnonzero((time > time[0] + _FROM_THE_EDGE) & (time < time[-1] - _FROM_THE_EDGE))
    if not len(inner):
        return None
    # A step at each batch; constant errors of homes and grasps explain a part of it.
    explained = _sums_to_the_end(views.scale[:, None] * views.basis)[inner]
    size = (len(time) - inner)[:, None, None] * np.diag(views.scale**2)
    inverse = np.linalg.pinv(size - explained @ explained.swapaxes(-1, -2), hermitian=True)
    score = _sums_to_the_end((views.scale * views.rest).swapaxes(0, 1))[inner]
    solution = score @ inverse
    # A step of one robot also moves the mean of all, from which views are measured.
    gains = np.sum(solution * score, axis=-1) * count / (count - 1)
    start, robot = map(int, np.unravel_index(int(np.argmax(gains)), gains.shape))
    before = float(np.sum(views.rest**2))
    if before - gains[start, robot] > _LEFT * before:
        return None
    jump = solution[start, robot] * count / (count - 1)
    # It is a perturbation of the load as the robot sees it, about the load's origin.
    shift = float(np.linalg.norm(jump[3:] + np.cross(jump[:3], evidence.poses[robot].translation)))
    turn_deg, when = float(np.degrees(np.linalg.norm(jump[:3]))), float(time[inner[start]]) - 0.5 * _BATCH
    culprit = evidence.culprit(robot)
    whose = culprit or f"{evidence.recording.names[robot]} (or of the other robot)"
    words = (
        f"the grasp of {whose} slipped at {when:.1f} s, by {1e3 * shift:.3g} mm and {turn_deg:.2g} degrees, or its "
        f"home moved: choose a part without this with --from and --to"
    )
    return Verdict(Cause.SLIP, culprit, (turn_deg, shift, when), words)


def _sums_to_the_end(samples: Array) -> Array:
    """Sums of samples (b, ...) from each to the last."""
    return np.cumsum(samples[::-1], axis=0)[::-1]


def _stretched(evidence: Evidence, views: _Views) -> Verdict | None:
    """Find a robot whose positions are too large or too small by a factor; a calibration estimates this along."""
    if evidence.tolerances is not None:
        return None
    names, (count, batches) = evidence.recording.names, views.rest.shape[:2]
    gains, excesses, deviations = np.empty((3, count))
    columns = np.empty((count, batches, 6))
    for robot, positions in enumerate(views.positions):
        column = np.hstack([np.zeros((batches, 3)), positions]) * views.scale
        columns[robot] = column = column - views.basis @ np.einsum("biq,bi->q", views.basis, column)
        size = float(np.sum(column**2))
        own = views.rest[robot] * count / (count - 1)
        excess = float(np.sum(column * own)) / size
        left = own - excess * column
        square = np.sum(left**2)
        # The residuals of a compliant grip are correlated.
        correlation = float(np.clip(np.sum(left[1:] * left[:-1]) / square, 0.0, 0.95))
        variance = square / left.size * (1.0 + correlation) / (1.0 - correlation) / size
        gains[robot], excesses[robot], deviations[robot] = excess**2 * size, excess, np.sqrt(variance)
    worst = int(np.argmax(gains))
    excess, std, culprit = float(excesses[worst]), float(deviations[worst]), evidence.culprit(worst)
    effect = abs(excess) * np.sqrt(np.mean((columns[worst] / views.scale) ** 2))
    if abs(excess) < max(_SURE * std, _STRETCHED) or effect < _FINEST:
        return None
    factor = 1.0 / (1.0 - excess)  # the excess is a share of the positions as they were recorded
    std *= factor**2
    is_large = bool(evidence.suspicions) or abs(factor - 1.0) > _CALIBRATED
    if is_large and gains[worst] * count / (count - 1) < _MOST * np.sum(views.rest**2):
        return None  # something else is wrong, which lengths explain a part of
    other = "" if culprit else f", or those of {names[1 - worst]} {1.0 / factor:.4g} times"
    words = (
        f"positions of {names[worst]} are {factor:.4g} times what they should be by the others' (std {std:.2g}){other}"
        f": another unit, or calibration (--calibrate)"
    )
    return Verdict(Cause.LENGTH_SCALE, culprit, (factor,), words, is_open=culprit is None)


def clock_delays(signals: Signals, poses: Sequence[Pose]) -> tuple[Array, Array]:
    """Delay of each robot's motion against the mean of the others'; ``poses`` are in the body frame.

    A robot whose clock is late by ``tau`` measures ``w(t - tau)``, about ``w - tau alpha``. Its grasp is then estimated
    with a rotation by some ``phi``, which adds ``phi x w``. Both are fitted, with ``w`` and ``alpha`` from the others.
    Only the part of ``alpha`` on which the robot and the others agree shows a delay: the rest is noise.

    Returns:
        Delays and their standard deviations, shape (N,) each [s]; infinite if there is nothing but noise.
    """
    motions = body_motions(signals, poses)
    mean = others(motions)
    delays, deviations = np.empty(len(poses)), np.empty(len(poses))
    for robot, (own, other) in enumerate(zip(motions, mean, strict=True)):
        at = CubicSpline(signals.time, np.hstack([other[:, BODY_W], other[:, BODY_ALPHA]]))
        delay = 0.0
        for _ in range(_STEPS):
            w, alpha = np.hsplit(at(np.clip(signals.time - delay, signals.time[0], signals.time[-1])), 2)
            turned = [np.cross(axis, w).ravel() for axis in np.eye(3)]
            columns = np.stack([-alpha.ravel(), *turned], axis=-1)
            difference = (own[:, BODY_W] - w).ravel()
            solution = np.linalg.lstsq(columns, difference)[0]
            delay = float(np.clip(delay + np.clip(solution[0], -_STEP, _STEP), -_LONGEST, _LONGEST))
            if abs(solution[0]) < _FOUND:
                break
        left = difference - columns @ solution
        delays[robot], deviations[robot] = delay, _deviation(left, columns, own[:, BODY_ALPHA].ravel())
    return delays, deviations


def _deviation(left: Array, columns: Array, acceleration: Array) -> float:
    """Standard deviation of a delay [s].

    ``left`` (3 n,) are residuals of the angular velocity, of all axes in turn, ``columns`` (3 n, 4) derivatives by the
    delay, which are noisy, and by a rotation, and ``acceleration`` (3 n,) is the robot's own.
    """
    turns = columns[:, 1:]
    shown = columns[:, 0] - turns @ np.linalg.lstsq(turns, columns[:, 0])[0]
    agreed = -float(shown @ acceleration)
    if agreed <= 0.0:
        return np.inf
    # The deviation of their scalar product if residuals of the same spectrum had random phases.
    powers = [np.abs(np.fft.fft(signal.reshape(-1, 3), axis=0)) ** 2 for signal in (left, shown)]
    return float(np.sqrt(np.sum(powers[0] * powers[1])) / (len(left) / 3) / agreed)
