"""Many simulated experiments: all configurations, with and without calibration errors, by several methods."""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Literal

import msgspec
import numpy as np
from msgspec.structs import replace

from coheft.app.identify.choices import Method, Options
from coheft.app.identify.methods import fitted
from coheft.app.identify.report import load_errors, pose_errors
from coheft.app.mocobots.record import record, record_sphere
from coheft.app.run.parallel import side_by_side, workers
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Recording, Truth
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.scenario.encoders import EncoderErrors
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario

PAIRS = ((0, 1), (1, 2), (2, 0))
"""Pairs of robots, in the order of the tables."""
ROWS = (
    *("rotation 12, °", "rotation 23, °", "rotation 31, °", "position 12, mm", "position 23, mm", "position 31, mm"),
    *("mass, kg", "centre of mass, mm", "inertia 1, %", "inertia 2, %", "inertia 3, %"),
)
Noise = Literal["vibration", "calibration"]
_METHODS: dict[Noise, tuple[Method, ...]] = {
    "vibration": ("batch", "instruments", "pose"),
    "calibration": ("batch", "pose"),
}


PAPER: dict[str, tuple[float, ...]] = {
    "a": (0.94, 0.99, 1.07, 7, 42, 51, 0.11, 21, *np.hypot((3.6, 4.1, 1.8), (1.6, 0.7, 3.0)).tolist()),
    "b": (1.77, 0.90, 1.93, 16, 39, 39, 0.07, 18, *np.hypot((3.1, 2.5, 4.4), (3.0, 3.0, 1.0)).tolist()),
    "c": (0.66, 2.21, 1.67, 38, 46, 63, 0.11, 39, *np.hypot((0.3, 1.6, 3.8), (4.0, 4.9, 2.2)).tolist()),
    "d": (2.55, 3.57, 1.49, 19, 57, 29, 0.18, 23, *np.hypot((2.8, 0.8, 0.1), (3.4, 2.8, 4.4)).tolist()),
}
"""Errors of Zhang et al. (2025) on hardware, Tables II to V, in the order of ``ROWS``, by configuration.

They are means of absolute values; of principal inertias ``sqrt(mean² + std²)`` of signed values.
"""


class Trial(msgspec.Struct, frozen=True):
    """Errors of one method on one recording.

    Attributes:
        configuration: Configuration of the paper.
        noise: ``vibration``: encoders and vibration only; ``calibration``: with calibration errors as well.
        method: Method of identification; ``pose`` estimates calibration errors if there are some.
        number: Number of the experiment; its motion goes through via points if it is odd, and on a sphere if even.
        rows: Errors in the order of ``ROWS``; absolute values except of inertias.
    """

    configuration: str
    noise: Noise
    method: Method
    number: int
    rows: list[float]


class Mocobots(msgspec.Struct, frozen=True):
    """All trials, and the number of experiments per configuration and noise."""

    trials: list[Trial]
    experiments: int

    def rows(self, configuration: str, noise: Noise, method: Method) -> Array:
        """Errors, shape (experiments, 11)."""
        key = (configuration, noise, method)
        return np.array([one.rows for one in self.trials if (one.configuration, one.noise, one.method) == key])


def run_campaign(
    configurations: Sequence[str],
    numbers: Sequence[int],
    jobs: int | None = None,
    on_progress: Callable[[], None] = lambda: None,
) -> Mocobots:
    """Run the experiments of these numbers for each noise and some of the configurations ``a`` to ``d``.

    Without ``jobs`` there is a process per core; ``on_progress`` is called after each experiment.

    Raises:
        MissingPackageError: joblib is not installed.
    """
    tasks = list(product(configurations, _METHODS, numbers))
    trials: list[Trial] = []
    with workers(jobs):
        for found in side_by_side(run_experiment, tasks):
            trials += found
            on_progress()
    trials.sort(key=lambda trial: (trial.configuration, trial.noise, trial.method, trial.number))
    return Mocobots(trials, len(numbers))


def experiments_in(configurations: Sequence[str], experiments: int) -> int:
    """Total number of experiments."""
    return len(configurations) * len(_METHODS) * experiments


def run_experiment(configuration: str, noise: Noise, number: int) -> list[Trial]:
    """Simulate a recording, and identify the load by all methods."""
    scenario = scenario_of(configuration, noise, number)
    recording = record(scenario) if number % 2 else record_sphere(scenario)
    trials = []
    for method in _METHODS[noise]:
        options = Options(calibrate=noise == "calibration" and method == "pose")
        rows = errors_of(recording, fitted(recording, method, options))
        trials.append(Trial(configuration, noise, method, number, rows))
    return trials


def scenario_of(configuration: str, noise: Noise, number: int) -> Scenario:
    """The scenario of an experiment."""
    scenario = load_scenario(f"mocobot_{configuration}")
    encoders = scenario.sensors.encoders or EncoderErrors()
    if noise == "vibration":
        encoders = EncoderErrors(
            angle_bits=encoders.angle_bits,
            position_step=encoders.position_step,
            vibration_deg=encoders.vibration_deg,
            vibration_mm=encoders.vibration_mm,
        )
    # The same robots for all configurations, as in the paper, but others in each experiment.
    encoders = replace(encoders, calibration_seed=number)
    seed = 100 * sorted(PAPER).index(configuration) + number
    return replace(scenario, seed=seed, sensors=replace(scenario.sensors, encoders=encoders))


def errors_of(recording: Recording, found: Identification) -> list[float]:
    """Errors in the order of ``ROWS``."""
    truth, load = truth_of(recording)
    rotations, positions = zip(*(pose_errors(truth, found, i, j) for i, j in PAIRS), strict=True)
    mass, com, principal = load_errors(found.payload.inertia, load)
    return [*rotations, *positions, abs(mass), com, *principal]


def truth_of(recording: Recording) -> tuple[Truth, Inertia]:
    """The truth of a simulated recording, and the load, which does not change."""
    truth = recording.truth
    assert truth is not None
    (_, load), *_ = truth.loads
    return truth, load
