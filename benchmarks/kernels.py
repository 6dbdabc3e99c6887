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
from benchmarks.kernel_data import Samples
from benchmarks.kernel_references import (
    InertiaRecursion,
    PoseRecursion,
    acceleration,
    consensus_round,
    regressor,
)
from benchmarks.runner import run_alone
from benchmarks.timing import interleaved, ratio
from coheft.errors import CoheftError
from coheft.estimation.body_motion import BODY_A, BODY_ALPHA
from coheft.estimation.dual_quaternion import pair_operator, solve_rotation
from coheft.estimation.inertia import InertiaModel, features, packed_gram, regressor_coefficients
from coheft.estimation.spatial import Array
from coheft.estimation.twist_registration import TwistMoments
from consensus.pipeline import NeighbourStages, Pipeline

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
    samples = Samples.make(4000)
    contests = [*pose(samples), sums(), fusion(samples), *inertia(samples)]
    skipped = []
    try:
        contests.append(body_regressor(samples))
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


def pose(samples: Samples) -> list[Contest]:
    """Moments of a pair's twists per block, against the dual-quaternion recursion; the pose that follows is equal."""
    own, other = samples.sensed[0, :, :6], samples.sensed[1, :, :6]
    recursion = PoseRecursion()
    for mine, its in zip(own, other, strict=True):
        recursion.update(mine, its)
    gram = sum(
        (TwistMoments.of(own[k : k + BLOCK], other[k : k + BLOCK]) for k in range(0, len(own), BLOCK)),
        TwistMoments.none(),
    ).gram
    moment = _quaternion_moment(gram[1:, 1:])
    check_equal("pose, moments", moment, np.hstack([recursion.rotation_moment, recursion.mixed_moment]))
    rotation, expected = solve_rotation(moment[:, :4]), recursion.solve()[0]
    check_equal("pose, rotation", np.outer(rotation, rotation), np.outer(expected, expected))

    def take_in() -> None:
        for mine, its in zip(own[:BLOCK], other[:BLOCK], strict=True):
            recursion.update(mine, its)

    def take_in_and_solve() -> None:
        for mine, its in zip(own[:BLOCK], other[:BLOCK], strict=True):
            recursion.update(mine, its)
            recursion.solve()

    def kernel() -> object:
        return TwistMoments.of(own[:BLOCK], other[:BLOCK])

    return [
        Contest("pose, taken in, against the seed's recursion", kernel, take_in, bar=_BAR),
        Contest("pose, taken in, against the recursion with a pose per sample", kernel, take_in_and_solve),
    ]


def _quaternion_moment(second: Array) -> Array:
    """``sum H(w)^T [H(w), H(v)]`` (4, 8) of samples with the second moment of ``(w_i, v_i, w_j, v_j)`` (12, 12)."""
    units = np.eye(12).reshape(12, 4, 3)
    by_w = pair_operator(units[:, 0], units[:, 2])
    by_v = pair_operator(units[:, 1], units[:, 3])
    result: Array = np.einsum("kl,kab,lac->bc", second, by_w, np.concatenate([by_w, by_v], axis=2))
    return result


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


def fusion(samples: Samples) -> Contest:
    """Body motion of a block out of the sums, against least squares over six accelerometers per sample."""
    block = slice(0, BLOCK)
    readings = samples.sensed[:, block, 6:9]

    def kernel() -> Array:
        return samples.fusion.motion(samples.sums[block])

    w = kernel()[:, :3]

    def reference() -> Array:
        return acceleration(samples.poses, w, readings)

    check_equal("acceleration", kernel()[:, BODY_A.start : BODY_ALPHA.stop], reference())
    return Contest("acceleration, against least squares per sample", kernel, reference)


def inertia(samples: Samples) -> list[Contest]:
    """Ten parameters after every block, against recursive least squares; they are equal in the end."""
    covariance, nothing = samples.fusion.wrench_covariance, np.zeros((6, 6))
    model, prior = InertiaModel(covariance, nothing), np.eye(10)
    recursion = InertiaRecursion(covariance, prior)
    for motion, wrench in zip(samples.motion, samples.wrench, strict=True):
        recursion.update(regressor(motion), wrench)
    gram = packed_gram(features(samples.motion, samples.wrench))
    block = slice(0, BLOCK)

    def take_in() -> Array:
        return gram + packed_gram(features(samples.motion[block], samples.wrench[block]))

    def solution(total: Array) -> Array:
        information = model.information(total)
        return np.asarray(np.linalg.solve(information.matrix + prior, information.vector))

    check_equal("inertia", solution(gram), recursion.parameters)

    def reference() -> None:
        for motion, wrench in zip(samples.motion[block], samples.wrench[block], strict=True):
            recursion.update(regressor(motion), wrench)

    return [
        Contest("inertia, taken in, against the seed's recursion", take_in, reference, bar=_BAR),
        Contest("inertia, a solution per block, against it", lambda: solution(take_in()), reference, bar=_BAR),
    ]


def body_regressor(samples: Samples) -> Contest:
    """Regressors of a block, against Pinocchio's, sample by sample from Python.

    Raises:
        ImportError: Pinocchio is not installed.
    """
    import pinocchio

    w, v, a, alpha = np.split(samples.motion[:BLOCK], 4, axis=1)
    order = [0, 1, 2, 3, 4, 6, 9, 5, 7, 8]  # Pinocchio packs the inertia as xx xy yy xz yz zz
    coefficients = regressor_coefficients(with_offset=False)[:, :, :-1].reshape(19, 60)

    def kernel() -> Array:
        rows: Array = (features(samples.motion[:BLOCK], samples.wrench[:BLOCK]) @ coefficients).reshape(-1, 6, 10)
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
