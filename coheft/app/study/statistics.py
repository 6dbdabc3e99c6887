"""Statistics over independent runs. Robots of the same run are not independent, so the unit is the run."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from coheft.estimation.geometry.spatial import Array

_RESAMPLES = 2000
_CONFIDENCE = 0.95
_TAILS = (0.5 * (1.0 - _CONFIDENCE), 0.5 * (1.0 + _CONFIDENCE))


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


_NOTHING = Interval(float("nan"), float("nan"), float("nan"))


def root_mean(squares: Sequence[Array]) -> float:
    """Return the root mean square of all finite values of all runs; NaN if there are none."""
    known = np.concatenate(squares)
    known = known[np.isfinite(known)]
    return float(np.sqrt(known.mean())) if len(known) else float("nan")


def ratio_of_roots(squares: Sequence[Array], references: Sequence[Array]) -> Interval:
    """Return a root mean square divided by that of a reference, where both are finite, with its bootstrap interval.

    Squares and references are those of each run, shape (k,).
    """
    known = [np.isfinite(s) & np.isfinite(r) for s, r in zip(squares, references, strict=True)]
    sums = np.array(
        [(s[k].sum(), r[k].sum()) for s, r, k in zip(squares, references, known, strict=True) if k.any()]
    ).reshape(-1, 2)
    if len(sums) == 0:
        return _NOTHING
    draws = np.random.default_rng(0).integers(len(sums), size=(_RESAMPLES, len(sums)))
    resampled = sums[draws].sum(axis=1)
    ratios = np.sqrt(resampled[:, 0] / resampled[:, 1])
    total = sums.sum(axis=0)
    low, high = np.quantile(ratios, _TAILS)
    return Interval(float(np.sqrt(total[0] / total[1])), float(low), float(high))


def normalised_square(
    errors: Sequence[Array], covariances: Sequence[Array], confidence: float = _CONFIDENCE, alike: int = 1
) -> Interval:
    """Return the mean of ``e^T C^-1 e`` per degree of freedom, which is 1 if ``C`` is right, and its expected interval.

    Args:
        errors: Independent errors, one of each run, shape (d,); runs with NaN are left out.
        covariances: Their covariances, shape (d, d).
        confidence: Probability of the interval.
        alike: Number of errors that are from the same run, at several times or noises: they count as one.
    """
    known = [(e, c) for e, c in zip(errors, covariances, strict=True) if np.isfinite(e).all()]
    if not known:
        return _NOTHING
    squares = [float(e @ np.linalg.solve(c, e)) for e, c in known]
    size = len(known) * len(known[0][0])
    freedom = size / alike
    low, high = (float(chdtri(freedom, above)) / freedom for above in (0.5 + 0.5 * confidence, 0.5 - 0.5 * confidence))
    return Interval(sum(squares) / size, low, high)
