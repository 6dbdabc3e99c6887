"""How honest are the covariances of ``coheft identify``? NEES of each method over recordings of the mocobots.

The squared error in units of the covariance, per degree of freedom, of the load's ten numbers and of the grasps: its
mean is 1 if covariances are right, less if they are too large. The interval is that of 95 % of such means of as many
independent recordings. Payloads of one experiment are carried by robots with the same calibration errors.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from benchmarks.command import run_command
from coheft.app.identify.choices import Bounds, Method, Options
from coheft.app.identify.methods import fitted
from coheft.app.mocobots.campaign import Noise, scenario_of
from coheft.app.mocobots.record import record, record_sphere
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Truth
from coheft.estimation.geometry.body_motion import perturbation_between
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import Inertia

_METHODS: dict[Noise, tuple[Method, ...]] = {"vibration": ("batch", "instruments", "pose"), "calibration": ("pose",)}
_PARTS = {"mass": slice(0, 1), "centre of mass": slice(1, 4), "inertia": slice(4, 10), "load": slice(0, 10)}


def main(payloads: str = "abcd", *, experiments: int = 8, first: int = 1) -> None:
    """Print the NEES of each payload and method.

    Args:
        payloads: Some of ``a`` to ``d``.
        experiments: Number of recordings of each payload, without and with calibration errors.
        first: Number of the first; the others follow consecutively.
    """
    for payload in payloads:
        found: dict[str, list[Array]] = {}
        for number in range(first, first + experiments):
            for noise, methods in _METHODS.items():
                for name, squares in nees(payload, noise, number, methods).items():
                    found.setdefault(name, []).append(squares)
        for name, rows in found.items():
            sizes = np.array([part.stop - part.start for part in _PARTS.values()])
            low, high = chi2.interval(0.95, experiments * sizes) / (experiments * sizes)
            means = np.mean(rows, axis=0)
            parts = (
                f"{part} {mean:.2f} ({least:.2f} to {most:.2f})"
                for part, mean, least, most in zip(_PARTS, means, low, high, strict=False)
            )
            print(f"payload {payload}, {name}: {', '.join(parts)}, grasps {means[-1]:.2f}", flush=True)


def nees(payload: str, noise: Noise, number: int, methods: tuple[Method, ...]) -> dict[str, Array]:
    """NEES per degree of freedom by method: of the parts of the load, then of the grasps, shape (5,)."""
    scenario = scenario_of(payload, noise, number)
    recording = record(scenario) if number % 2 else record_sphere(scenario)
    truth = recording.truth
    load = None if truth is None else truth.load_between(float(recording.time[0]), float(recording.time[-1]))
    assert truth is not None
    assert load is not None
    bounds = Bounds() if noise == "calibration" else None
    return {
        "calibrated" if bounds else method: _squares(
            fitted(recording, method, Options(calibrate=bounds is not None, bounds=bounds)), load, truth
        )
        for method in methods
    }


def _squares(found: Identification, load: Inertia, truth: Truth) -> Array:
    error, covariance = found.payload.inertia.central() - load.central(), found.payload.covariance
    squares = [_square(error[part], covariance[part, part]) for part in _PARTS.values()]
    first = truth.poses[0].inverse()
    grasps = [perturbation_between(own, first @ true) for own, true in zip(found.team.poses, truth.poses, strict=True)]
    return np.array([*squares, _square(np.concatenate(grasps[1:]), found.team.covariance[6:, 6:])])


def _square(error: Array, covariance: Array) -> float:
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


if __name__ == "__main__":
    run_command(main, __doc__)
