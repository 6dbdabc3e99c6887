"""A common path along which all robots carry the payload, as a scenario asks for it."""

from __future__ import annotations

from coheft.estimation.measurement import Positive
from coheft.wire.scenario.section import NotNegative, Section


class Carry(Section, frozen=True):
    """A common path, a sinusoid per coordinate: how the first robot's grasp frame moves, in the axes of its home frame.

    All others follow as parts of a rigid body, each with its own estimate of the first one's grasp. Until ``start``, or
    until it has that estimate, a robot moves as ``motion`` says.

    Attributes:
        start: When the common path begins [s].
        ramp: Time from rest to its full amplitude [s].
        translation: Amplitude along x, y, z [m].
        translation_period: Period along x, y, z [s].
        rotation_deg: Amplitude of the rotation vector's coordinates [degrees].
        rotation_period: Their periods [s].
        feedforward: Whether robots apply feed-forward forces from their estimates, or leave the weight to their
            springs.
        feedforward_at: Time from which they do; before it springs alone act, for comparison [s].
        force_limit: Largest feed-forward force of one robot [N].
        torque_limit: Largest feed-forward torque of one robot [N·m].
    """

    start: NotNegative = 10.0
    ramp: Positive = 2.0
    translation: tuple[NotNegative, NotNegative, NotNegative] = (0.2, 0.15, 0.1)
    translation_period: tuple[Positive, Positive, Positive] = (6.0, 4.5, 3.5)
    rotation_deg: tuple[NotNegative, NotNegative, NotNegative] = (8.0, 8.0, 12.0)
    rotation_period: tuple[Positive, Positive, Positive] = (4.0, 3.2, 7.0)
    feedforward: bool = True
    feedforward_at: NotNegative = 20.0
    force_limit: Positive = 60.0
    torque_limit: Positive = 20.0
