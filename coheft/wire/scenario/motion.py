"""Settings of motions: of every robot alone, and of all along a common path."""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from coheft.estimation.measurement import Positive
from coheft.wire.scenario.section import Name, NotNegative, Section

_Axes = tuple[float, float, float, float, float, float]


class ViaPoints(Section, frozen=True):
    """Random via points in the range of the motion's ``translation`` and ``axes``, straight lines between them.

    Attributes:
        count: Number of via points.
        transit: Range of the random time from one to the next [s].
        dwell: Range of the random time spent there [s].
        holds: Number of further random points where all robots hold still at the same times.
        hold_time: How long each of them is held [s].
        hold_transit: Time to get there [s].
    """

    count: Annotated[int, Meta(ge=2, le=10_000)] = 80
    transit: tuple[Positive, Positive] = (0.8, 2.0)
    dwell: tuple[NotNegative, NotNegative] = (0.2, 0.8)
    holds: Annotated[int, Meta(ge=0, le=1000)] = 6
    hold_time: Positive = 8.0
    hold_transit: Positive = 2.0


class Motion(Section, frozen=True):
    """Reference motion of every robot, drawn for each robot alone: two sinusoids per axis, via points, or your own.

    Motions that no arm can follow are refused: more than 2 m or one turn per axis, including what the speed adds.

    Attributes:
        translation: Amplitude per axis [m].
        rotation: Amplitude per axis [rad].
        frequency: Range from which frequencies are drawn [Hz].
        ramp: Time from rest to full amplitude [s].
        axes: Relative amplitude for each axis of the robot's home frame: rotation about x, y, z, translation along
            them.
        via_points: Instead of sinusoids: random points, joined by straight lines.
        own: Instead: name of a motion of your own, see docs/own.md.
    """

    translation: NotNegative = 0.06
    rotation: NotNegative = 0.2
    frequency: tuple[Positive, Positive] = (0.4, 1.6)
    ramp: NotNegative = 2.0
    axes: tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative] = (1.0,) * 6
    via_points: ViaPoints | None = None
    own: Name | None = None


class Waves(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Two sinusoids per axis of one robot's motion: rotation about x, y, z, translation along them.

    They are drawn when a run is planned, and part of the agent's configuration: a random number generator would take a
    tenth of an agent's memory, and is not needed for anything else.

    Attributes:
        frequencies: Frequencies of both [Hz].
        phases: Phases of both [rad].
    """

    frequencies: tuple[_Axes, _Axes]
    phases: tuple[_Axes, _Axes]


def draw_waves(frequency: tuple[float, float], seed: int) -> Waves:
    """Draw frequencies from a range [Hz], and phases; equal seeds give equal results."""
    rng = np.random.default_rng(seed)
    frequencies = rng.uniform(*frequency, size=(2, 6))
    phases = rng.uniform(0.0, 2.0 * np.pi, size=(2, 6))
    return msgspec.convert({"frequencies": frequencies.tolist(), "phases": phases.tolist()}, Waves)


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
