"""Errors of wrists with encoders for their pose and drives with springs for their force."""

from typing import Annotated

from msgspec import Meta

from coheft.wire.scenario.section import NotNegative, Section


class EncoderErrors(Section, frozen=True):
    """A force-controlled three-axis arm with a passive three-axis gimbal as wrist, as it appears in recordings.

    The wrist's position and force are measured in the axes of the robot's home frame. The gimbal's angles give the
    grasp frame's orientation there: ``R = R_x(a) R_y(b) R_z(c)``. In recordings the torque is zero, because a gimbal
    transmits none, and gravity is along the z axis of each home frame. So the arms must have no stiffness in rotation,
    and grasps may be turned about the vertical only; anything else is refused.

    The first four errors are drawn anew for every sample. The others are fixed for each robot, and drawn for each axis,
    except for the scales of position and force, which all axes share. They are uniform within plus or minus the given
    bound.

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
