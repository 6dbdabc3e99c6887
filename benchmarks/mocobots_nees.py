"""How honest are the covariances of ``coheft identify``? NEES of each method over recordings of the mocobots.

The squared error in units of the covariance, per degree of freedom, of the load's ten numbers and of the grasps: its
mean is 1 if covariances are right, less if they are too large. The interval is that of 95 % of such means of as many
independent recordings. Payloads of one experiment are carried by robots with the same calibration errors.
"""

import numpy as np

from benchmarks.command import run_command
from coheft.app.identify.choices import Bounds, Method, Options
from coheft.app.identify.methods import fitted
from coheft.app.mocobots.campaign import Noise, scenario_of, truth_of
from coheft.app.mocobots.record import record, record_sphere
from coheft.app.study.statistics import Interval, normalised_square
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.body_motion import perturbation_between
from coheft.estimation.geometry.spatial import Array

_METHODS: dict[Noise, tuple[Method, ...]] = {"vibration": ("batch", "instruments", "pose"), "calibration": ("pose",)}
_PARTS = {"mass": slice(0, 1), "centre of mass": slice(1, 4), "inertia": slice(4, 10), "load": slice(0, 10)}
_Errors = list[tuple[Array, Array]]
"""Errors (k,) with their covariances (k, k)."""


def main(payloads: str = "abcd", *, experiments: int = 8, first: int = 1) -> None:
    """Print the NEES of each payload and method.

    Args:
        payloads: Some of ``a`` to ``d``.
        experiments: Number of recordings of each payload, without and with calibration errors.
        first: Number of the first; the others follow consecutively.
    """
    for payload in payloads:
        loads: dict[str, _Errors] = {}
        grasps: dict[str, _Errors] = {}
        for number in range(first, first + experiments):
            for noise, methods in _METHODS.items():
                scenario = scenario_of(payload, noise, number)
                recording = record(scenario) if number % 2 else record_sphere(scenario)
                is_calibrated = noise == "calibration"
                options = Options(calibrate=is_calibrated, bounds=Bounds() if is_calibrated else None)
                for method in methods:
                    name = "calibrated" if is_calibrated else str(method)
                    of_load, of_grasps = errors(recording, fitted(recording, method, options))
                    loads.setdefault(name, []).append(of_load)
                    grasps.setdefault(name, []).append(of_grasps)
        for name in loads:
            found = {what: _nees(loads[name], part) for what, part in _PARTS.items()}
            parts = (f"{what} {nees.value:.2f} ({nees.low:.2f} to {nees.high:.2f})" for what, nees in found.items())
            grasp = _nees(grasps[name], slice(None)).value
            print(f"payload {payload}, {name}: {', '.join(parts)}, grasps {grasp:.2f}", flush=True)


def errors(recording: Recording, found: Identification) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Errors of the load (10,) and of all grasps but the first (6 N - 6,), each with its covariance."""
    truth, load = truth_of(recording)
    first = truth.poses[0].inverse()
    grasps = [perturbation_between(own, first @ true) for own, true in zip(found.team.poses, truth.poses, strict=True)]
    return (
        (found.payload.inertia.central() - load.central(), found.payload.covariance),
        (np.concatenate(grasps[1:]), found.team.covariance[6:, 6:]),
    )


def _nees(errors: _Errors, part: slice) -> Interval:
    return normalised_square([error[part] for error, _ in errors], [cov[part, part] for _, cov in errors])


if __name__ == "__main__":
    run_command(main, __doc__)
