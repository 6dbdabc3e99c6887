"""Kernels against plain references with equal results, per sample.

    python -m benchmarks.kernels [--effort short|usual|full]

Blocks have 20 samples. A ratio says how many times as much CPU time the reference takes for the same samples. What is
compared is first checked to be equal, to 1e-10 of its size.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.figures import Effort, Figure, Section, Skipped
from benchmarks.kernel_references import consensus_round
from benchmarks.runner import run_alone
from benchmarks.timing import interleaved, ratio
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.regressor import features, regressor_coefficients

BLOCK = 20
_BAR = 20.0
_EQUAL = 1e-10
_ROUNDS: dict[Effort, int] = {"short": 9, "usual": 25, "full": 100}
_STAGES, _CHANNELS = 3, 18


@dataclass(frozen=True)
class Contest:
    """A kernel and a reference that does the same for the same samples.

    Attributes:
        name: What they do.
        kernel: The product's, called once.
        reference: The other one, called once.
        samples: How many samples a call takes.
        bar: How many times as fast the kernel should be.
        is_guarded: Whether the regression guard compares it.
    """

    name: str
    kernel: Callable[[], object]
    reference: Callable[[], object]
    samples: int = BLOCK
    bar: float | None = None
    is_guarded: bool = True

    def figure(self, rounds: int) -> Figure:
        """The ratio."""
        times = interleaved({"kernel": self.kernel, "reference": self.reference}, rounds)
        kernel, reference = (1e6 * statistics.median(times[name]) / self.samples for name in ("kernel", "reference"))
        per_block = f"{kernel * BLOCK:.1f} µs a block" if self.samples == BLOCK else f"{self.samples} samples"
        return Figure(
            name=self.name,
            value=ratio(times["reference"], times["kernel"]),
            bar=self.bar,
            more_is_better=True,
            is_guarded=self.is_guarded,
            note=f"{kernel:.2f} against {reference:.2f} µs a sample; {per_block}",
        )


def measure(effort: Effort) -> Section:
    """All contests."""
    contests = [sums()]
    skipped = []
    try:
        contests.append(body_regressor())
    except ImportError as error:
        skipped.append(Skipped("regressor against Pinocchio", f"{error}; pip install 'coheft[bench]'"))
    figures = [contest.figure(_ROUNDS[effort]) for contest in contests]
    return Section(name="kernels", title="Kernels against plain references", figures=figures, skipped=skipped)


def check_equal(what: str, found: Array, expected: Array) -> None:
    """Check two results before their times are compared.

    Raises:
        CoheftError: They differ by more than 1e-10 times the largest number.
    """
    error = float(np.abs(found - expected).max() / np.abs(expected).max())
    if not error <= _EQUAL:
        raise CoheftError(f"{what}: kernel and reference differ by {error:.1e} but expected at most {_EQUAL:g}")


def sums() -> Contest:
    """A round of the network's sums for all blocks under way, two neighbours, three rounds."""
    rng = np.random.default_rng(2)
    own, left, right = rng.normal(size=(3, _STAGES, BLOCK, _CHANNELS))
    gains, valid = np.array([0.3, 0.2, 0.4]), np.ones(_STAGES, dtype=np.bool_)
    pipeline = Pipeline(_STAGES, BLOCK, _CHANNELS)
    neighbours = [NeighbourStages(None, gains, stages, valid) for stages in (left, right)]

    def kernel() -> Array | None:
        pipeline.stages[:] = own
        pipeline.valid[:] = True
        return pipeline.advance(neighbours, 1.0 - 2.0 * gains)

    def reference() -> Array:
        return consensus_round(own, [left, right], gains)

    found = kernel()
    assert found is not None
    check_equal("sums", np.vstack([*pipeline.stages[1:], found]), np.vstack([*reference()]))
    return Contest("one round of the sums, against sample by sample", kernel, reference)


def body_regressor() -> Contest:
    """Regressors of a block, against Pinocchio's, sample by sample from Python.

    Raises:
        ImportError: Pinocchio is not installed.
    """
    import pinocchio

    motion, wrench = np.random.default_rng(3).normal(size=(BLOCK, 12)), np.zeros((BLOCK, 6))
    w, v, a, alpha = np.split(motion, 4, axis=1)
    order = [0, 1, 2, 3, 4, 6, 9, 5, 7, 8]  # Pinocchio packs the inertia as xx xy yy xz yz zz
    coefficients = regressor_coefficients(with_offset=False)[:, :, :-1].reshape(19, 60)

    def kernel() -> Array:
        rows: Array = (features(motion, wrench) @ coefficients).reshape(-1, 6, 10)
        return rows

    spatial = a - np.cross(w, v)  # it wants the derivative of the velocity's coordinates

    def reference() -> list[Array]:
        return [
            pinocchio.bodyRegressor(pinocchio.Motion(v[k], w[k]), pinocchio.Motion(spatial[k], alpha[k]))
            for k in range(BLOCK)
        ]

    check_equal("regressor", kernel(), np.array(reference())[:, :, order])
    return Contest("regressor, against Pinocchio's body regressor", kernel, reference, is_guarded=False)


if __name__ == "__main__":
    run_alone("kernels", __doc__)
