"""Errors of wrists that know from encoders where they are, and from their drives' springs what they push with."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from coheft.wire.scenario.section import NotNegative, Section


class EncoderErrors(Section, frozen=True):
    """A force-controlled three-axis arm with a passive three-axis gimbal as wrist, as it appears in recordings.

    The wrist's position and force are measured in the axes of the robot's home frame, the gimbal's angles tell the
    grasp frame's orientation there: ``R = R_x(a) R_y(b) R_z(c)``. Recordings have a torque of zero, as a gimbal
    transmits none, and gravity along the home frames' z axes. So arms must have no stiffness in rotation, and grasps be
    turned about the vertical only: all else is refused.

    The first four are drawn anew for every sample. The others are fixed: each robot has its own (each axis too, but
    for the scales of position and force), uniform in plus or minus the given bound.

    Attributes:
        angle_bits: Resolution of the gimbal's encoders [bits per turn].
        position_step: Resolution of the position [m].
        vibration_deg: Vibration of each of the wrist's angles, standard deviation [degrees].
        vibration_mm: Vibration of each axis of its position, standard deviation [mm].
        misalignment_deg: Largest misalignment of the gimbal's zero, about a random axis [degrees].
        angle_scale: Largest relative error of the gimbal's angles.
        position_scale: Largest relative error of the position.
        force_scale: Largest relative error of the force.
        force_offset: Largest constant error of the force [N].
        calibration_seed: Seed of the fixed errors: robots with equal seeds are the same.
    """

    angle_bits: Annotated[int, Meta(ge=4, le=32)] = 13
    position_step: Annotated[float, Meta(gt=0)] = 1e-4
    vibration_deg: NotNegative = 0.035
    vibration_mm: NotNegative = 0.5
    misalignment_deg: NotNegative = 0.0
    angle_scale: NotNegative = 0.0
    position_scale: NotNegative = 0.0
    force_scale: NotNegative = 0.0
    force_offset: NotNegative = 0.0
    calibration_seed: Annotated[int, Meta(ge=0)] = 0
