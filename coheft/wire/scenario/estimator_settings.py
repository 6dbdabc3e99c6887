"""Settings of the estimators that come with coheft, and of convergence."""

from typing import Annotated, Literal

from msgspec import Meta

from coheft.estimation.measurement import Positive
from coheft.wire.scenario.section import Section


class Fan2017Settings(Section, frozen=True):
    """The method of Fan et al., CDC 2017 (``coheft.agents.fan2017.estimator``).

    Attributes:
        memory: Time over which old samples are forgotten [s]; the forgetting factor per sample is
            ``1 - 1 / (memory * rate)``.
        rounds: Rounds of dynamic consensus that each sample goes through.
        extrapolate: Whether a robot adds to a sum what more rounds would still change, see
            ``coheft.consensus.Extrapolation``; false is as in the paper.
        pose_rotation_deg: Largest standard deviation of a pose's rotation for it to have converged [degrees].
        pose_translation_mm: The same for its translation [mm].
        acceleration: Angular acceleration from the ``gyro`` alone, eq. (16), or from ``accelerometers``, eq. (17), with
            the gyro in directions that these do not observe.
        share_acceleration: Whether it is averaged over the team by dynamic consensus, eq. (18).
        share_estimates: Whether robots reach consensus on their estimates of the payload, eqs (31) and (32).
        consensus_weights: Weights of the edges: ``metropolis``, or ``uniform``, the inverse of one plus the largest
            number of neighbours: a step of eq. (34).
        equation_weights: Weights of observations: by their covariance at the present estimate, ``proposition-2``, or
            ``constant``, as in basic least squares.
        known: What robots know exactly of the payload before the load changes: any of ``mass``, ``com`` and
            ``inertia``; eqs (25) to (27) in place of (30).
        initial_mass: First guess of the mass [kg].
        initial_com: First guess of the centre of mass: the ``centre`` of all grasps, or the robot's own ``grasp``.
    """

    memory: Positive = 2.0
    rounds: Annotated[int, Meta(ge=1, le=256)] = 16
    extrapolate: bool = True
    pose_rotation_deg: Positive = 0.18
    pose_translation_mm: Positive = 3.6
    acceleration: Literal["gyro", "accelerometers"] = "accelerometers"
    share_acceleration: bool = True
    share_estimates: bool = True
    consensus_weights: Literal["metropolis", "uniform"] = "metropolis"
    equation_weights: Literal["proposition-2", "constant"] = "proposition-2"
    known: tuple[Literal["mass", "com", "inertia"], ...] = ()
    initial_mass: Positive = 1.0
    initial_com: Literal["centre", "grasp"] = "centre"


class EfficientSettings(Section, frozen=True):
    """The method at the Cramér-Rao bound (``coheft.agents.efficient``).

    Attributes:
        memory: Time over which the past counts [s]: "window" keeps everything since the last detected load change; a
            number forgets exponentially over this time. Below 0.3 s no load can be identified.
    """

    memory: Literal["window"] | Annotated[float, Meta(ge=0.3)] = "window"


class Converged(Section, frozen=True):
    """An agent calls its estimate converged when all standard deviations are below these.

    Attributes:
        mass_percent: Standard deviation of the mass, relative [%].
        com_mm: Standard deviation of each coordinate of the centre of mass [mm].
        inertia_percent: Standard deviation of the inertia, Frobenius norm relative to its own [%].
    """

    mass_percent: Positive = 1.0
    com_mm: Positive = 7.0
    inertia_percent: Positive = 5.0
