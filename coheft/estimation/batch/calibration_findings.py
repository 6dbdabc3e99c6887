"""What an identification says of the robots' calibration, robot by robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.batch.calibrated_fit import CalibratedFit
from coheft.estimation.batch.calibration import POSITION_SCALE, UNIFORM_BOUND, Tolerances
from coheft.estimation.batch.hand_eye import HandEye
from coheft.estimation.batch.hand_eye_equations import position_scale_rows
from coheft.estimation.batch.identification import CalibrationFinding
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE


def calibration_findings(
    names: Sequence[str], grasps: HandEye, fit: CalibratedFit, tolerances: Tolerances
) -> tuple[CalibrationFinding, ...]:
    """All that may be wrong, robot by robot."""
    count = len(names)
    spread = np.sqrt(np.diag(fit.covariance))[INERTIA_SIZE + 1 :]
    common = 1.0 / fit.scale
    labels = [
        "zero of angle a",
        "zero of angle b",
        "zero of angle c",
        "scale of angle a",
        "scale of angle b",
        "scale of angle c",
        "position scale",
    ]
    units = ["deg"] * 3 + ["%"] * 4
    sizes = np.repeat([np.degrees(1.0), 100.0], [3, 4])
    before = tolerances.pose_errors()
    rows = position_scale_rows(count)
    contrasts = rows - rows.mean(axis=0)
    ratio_std = np.sqrt(np.einsum("ku,uv,kv->k", contrasts, grasps.covariance, contrasts))
    found = []
    for k, name in enumerate(names):
        values, stds = grasps.errors[k].copy(), grasps.errors_std[k].copy()
        values[POSITION_SCALE] = (1.0 + values[POSITION_SCALE]) * common - 1.0
        stds[POSITION_SCALE] = np.hypot(ratio_std[k], np.sqrt(fit.covariance[INERTIA_SIZE, INERTIA_SIZE]))
        found += [
            CalibrationFinding(name, *row)
            for row in zip(labels, units, sizes * values, sizes * stds, sizes * before, strict=True)
        ]
        found.append(
            CalibrationFinding(
                name, "force scale", "%", 100 * fit.force_scale[k], 100 * spread[k], 100 * tolerances.force_scale
            )
        )
        for axis in range(3):
            std = spread[count + 3 * k + axis]
            value = float(fit.force_offset[k, axis])
            found.append(
                CalibrationFinding(name, f"force offset {'xyz'[axis]}", "N", value, std, tolerances.force_offset)
            )
    return tuple(found)


def beyond_bounds(findings: Sequence[CalibrationFinding]) -> str:
    """That no errors within the bounds explain a recording, and which of them is farthest beyond, in words.

    Zeros, whose distribution has no bounds, are left out.
    """
    bounded = [finding for finding in findings if not finding.what.startswith("zero")]
    worst = max(bounded, key=lambda finding: (abs(finding.value) - UNIFORM_BOUND * finding.before) / finding.std)
    return (
        f"No calibration errors within the bounds explain this recording: the {worst.what} of {worst.robot} would be "
        f"{worst.value:.3g} {worst.unit} (std {worst.std:.2g}), the bound is {UNIFORM_BOUND * worst.before:.3g} "
        f"{worst.unit}, and nothing says how far the others are beyond theirs. Check that robot; or, if all may be as "
        f"far off, say so by wider bounds, as --force-scale or --position-scale"
    )
