"""Results that no robots and no load can have: something is wrong with the recording."""

from collections.abc import Sequence

import numpy as np

from coheft.estimation.batch.payload import Payload
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.rigid_body.unobservable import middle_and_size

_FAR = 10.0
"""Distance from all possible bodies, in standard deviations, that noise does not explain."""
_FARTHEST = 20.0
"""No load is longer [m]: lengths must be in another unit."""
_DENSEST = 2.3e4
"""No material is denser [kg/m³]."""
_METRES = "Are all lengths in metres, moments in N·m, and angular velocities in rad/s?"


def unsettled(team: TeamPoses) -> tuple[str, ...]:
    """Say that a fit of poses did not converge; poses that are not observable need not."""
    if team.is_settled or not team.is_observable:
        return ()
    return (
        "The fit of the poses did not converge. Are poses and twists those of grasp frames, and do all clocks agree? "
        "Did a robot let go (--from and --to choose a part)?",
    )


def solid_density(payload: Payload, slack: float) -> float:
    """Density of the homogeneous ellipsoid with these mass properties [kg/m³]: any other body is denser somewhere.

    The inertia, which is known, may be larger by ``slack`` standard deviations.
    """
    mass, tensor = payload.inertia.mass, payload.inertia.tensor
    second = np.maximum(0.5 * np.trace(tensor) - np.linalg.eigvalsh(tensor), 0.0) + slack * payload.std[4:].max()
    volume = 4.0 / 3.0 * np.pi * np.sqrt(np.prod(5.0 * second / mass))
    return float(mass / max(volume, 1e-300))


def doubts_about(names: Sequence[str], team: TeamPoses, payload: Payload) -> tuple[str, ...]:
    """Contradictions in what was identified, as sentences."""
    doubts = []
    relative = [team.relative(0, k) for k in range(1, len(names))]
    far = {
        name: distance
        for name, pose in zip(names[1:], relative, strict=True)
        if not pose.unobservable and (distance := float(np.linalg.norm(pose.pose.translation))) > _FARTHEST
    }
    if far:
        distances = ", ".join(f"{name} {distance:.0f} m" for name, distance in far.items())
        doubts.append(f"Robots that hold one load would be too far from {names[0]}: {distances}. {_METRES}")
    middle, _ = middle_and_size(team.poses)
    away = float(np.linalg.norm(payload.inertia.com - middle))
    if away > _FARTHEST and payload.is_seen("com") and not far:
        doubts.append(f"The centre of mass would be {away:.0f} m from where robots hold the load. {_METRES}")
    density = solid_density(payload, _FAR) if payload.is_seen("inertia") else 0.0
    if density > _DENSEST and not doubts:
        doubts.append(
            f"Mass and moments of inertia would be those of something of at least {density:.3g} kg/m³, denser than any "
            f"material: are forces in newtons?"
        )
    if payload.deviations_off > _FAR and payload.is_seen("inertia") and team.is_observable:
        doubts.append(
            f"The mass properties are physically impossible, by {payload.deviations_off:.0f} of their standard "
            f"deviations. Are forces and moments those on the load, in the axes of the grasp frame, and do all clocks "
            f"agree? Did the load change (--from and --to choose a part)? Are the robots badly calibrated (--method "
            f"pose --calibrate, which needs poses)?"
        )
    return tuple(doubts)
