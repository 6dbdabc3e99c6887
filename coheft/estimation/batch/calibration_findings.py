"""Calibration errors of all robots, as an identification reports them."""

from collections.abc import Iterable, Sequence

import numpy as np

from coheft.estimation.batch.calibrated_fit import CalibratedFit
from coheft.estimation.batch.calibration import POSITION_SCALE, UNIFORM_BOUND, Tolerances
from coheft.estimation.batch.hand_eye import HandEye
from coheft.estimation.batch.hand_eye_equations import position_scale_rows
from coheft.estimation.batch.identification import CalibrationFinding
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

_DEG = float(np.degrees(1.0))
_KINDS = (
    *((f"zero of angle {angle}", "deg", _DEG) for angle in "abc"),
    *((f"scale of angle {angle}", "%", 100.0) for angle in "abc"),
    ("position scale", "%", 100.0),
    ("force scale", "%", 100.0),
    *((f"force offset {axis}", "N", 1.0) for axis in "xyz"),
)
"""Names, units, and factors to these units."""
_SEEN = 0.5
"""Share of its former standard deviation below which an error counts as seen."""


def calibration_findings(
    names: Sequence[str], has_gimbal: Iterable[np.bool_], grasps: HandEye, fit: CalibratedFit, tolerances: Tolerances
) -> tuple[CalibrationFinding, ...]:
    """All calibration errors, robot by robot; those of angles only of robots that have a gimbal."""
    count = len(names)
    std = np.sqrt(np.diag(fit.covariance))[INERTIA_SIZE:]
    rows = position_scale_rows(count)
    contrasts = rows - rows.mean(axis=0)
    ratio_std = np.sqrt(np.einsum("ku,uv,kv->k", contrasts, grasps.covariance, contrasts))
    errors, errors_std = grasps.errors.copy(), grasps.errors_std.copy()
    errors[:, POSITION_SCALE] = (1.0 + errors[:, POSITION_SCALE]) / fit.scale - 1.0
    errors_std[:, POSITION_SCALE] = np.hypot(ratio_std, std[0])[:, None]
    # In the order of _KINDS.
    values = np.column_stack([errors, fit.force_scale, fit.force_offset])
    stds = np.column_stack([errors_std, std[1 : 1 + count], std[1 + count :].reshape(count, 3)])
    before = np.append(tolerances.pose_errors(), [tolerances.force_scale, *[tolerances.force_offset] * 3])
    return tuple(
        CalibrationFinding(
            robot=name,
            what=what,
            unit=unit,
            value=size * float(value),
            std=size * float(own),
            std_before=size * float(former),
            seen=bool(own < _SEEN * former),
        )
        for name, is_gimbal, own_values, own_stds in zip(names, has_gimbal, values, stds, strict=True)
        for (what, unit, size), value, own, former in zip(_KINDS, own_values, own_stds, before, strict=True)
        if is_gimbal or "of angle" not in what
    )


def beyond_bounds(findings: Sequence[CalibrationFinding]) -> str:
    """Say that no errors within their bounds explain a recording, and which one is farthest beyond.

    Zeros, whose distribution has no bounds, are left out.
    """
    bounded = [finding for finding in findings if not finding.what.startswith("zero")]
    worst = max(bounded, key=lambda finding: (abs(finding.value) - UNIFORM_BOUND * finding.std_before) / finding.std)
    return (
        f"No calibration errors within the bounds explain this recording: the {worst.what} of {worst.robot} would be "
        f"{worst.value:.3g} {worst.unit} (std {worst.std:.2g}), the bound is {UNIFORM_BOUND * worst.std_before:.3g} "
        f"{worst.unit}, and nothing says how far the others are beyond theirs. Check that robot; or, if all may be as "
        f"far off, say so by wider bounds, as --force-scale or --position-scale"
    )
