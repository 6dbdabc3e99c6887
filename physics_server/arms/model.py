"""Seven-joint arms made of primitive shapes, each with its wrist welded to the payload."""

import mujoco
import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, quaternion_from_rotation, rotation_exp

JOINTS = 7
HOME_ANGLES = np.array([0.0, 0.2, 0.0, 1.9, 0.0, 0.5 * np.pi - 2.1, 0.0])
"""Joint angles at which the hand points forward, away from all singularities [rad]."""

# Joints from the base to the hand: distance from the previous one along the links [m], axis, mass of the link [kg].
_Z, _Y = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
_LINKS = (
    (0.15, _Z, 3.0),
    (0.18, _Y, 3.0),
    (0.16, _Z, 2.5),
    (0.16, _Y, 2.0),
    (0.19, _Z, 1.5),
    (0.19, _Y, 1.0),
    (0.07, _Z, 0.5),
)
_HAND = 0.08
"""Distance from the last joint to the wrist's force-torque sensor [m]."""
_RADIUS = 0.045
_JOINT_DAMPING = 0.5
"""Damping of each joint [N·m·s/rad]."""
_ROTOR = 0.05
"""Inertia of each joint's drive, as seen at the joint [kg·m²]."""
_HAND_MASS = 1e-5
"""Mass beyond the force-torque sensor, small enough to be ignored [kg]."""
_WELD_TIME = 0.004
"""Time constant with which a weld corrects its deviation [s]: four steps. With a shorter one, the accelerometers would
show the integrator's errors."""


def hand_name(robot: str) -> str:
    """Return the name of the hand's body and of its site, which is ``F_i`` according to the arm's kinematics."""
    return f"{robot}_hand"


def joint_name(robot: str, joint: int) -> str:
    """Return the name of a joint, counted from 0, and of its motor."""
    return f"{robot}_joint{joint}"


def hand_in_base() -> Pose:
    """Return the pose of the hand in the arm's base at the home angles."""
    pose = Pose.identity()
    for angle, (distance, axis, _) in zip(HOME_ANGLES, _LINKS, strict=True):
        pose = pose @ Pose(rotation_exp(angle * np.array(axis)), distance * np.array(_Z))
    return pose @ Pose(np.eye(3), _HAND * np.array(_Z))


def add_seven_joint_arm(spec: mujoco.MjSpec, robot: str, home: Pose) -> None:
    """Add an arm whose hand is at ``home`` in the world at the home angles, and weld it to its grasp site."""
    base = home @ hand_in_base().inverse()
    body = spec.worldbody.add_body(
        name=f"{robot}_base", pos=base.translation, quat=quaternion_from_rotation(base.rotation)
    )
    for number, (distance, axis, mass) in enumerate(_LINKS):
        body = body.add_body(name=f"{robot}_link{number}", pos=[0.0, 0.0, distance])
        body.add_joint(name=joint_name(robot, number), axis=axis, damping=[_JOINT_DAMPING, 0.0, 0.0], armature=_ROTOR)
        length = _LINKS[number + 1][0] if number + 1 < JOINTS else _HAND
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0.0, 0.0, 0.0, 0.0, 0.0, length],
            size=[_RADIUS, 0.0, 0.0],
            mass=mass,
            contype=0,
            conaffinity=0,
        )
        spec.add_actuator(
            name=joint_name(robot, number), trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint_name(robot, number)
        ).set_to_motor()
    hand = body.add_body(name=hand_name(robot), pos=[0.0, 0.0, _HAND])
    hand.explicitinertial = True
    hand.mass, hand.inertia = _HAND_MASS, [1e-9] * 3
    hand.add_site(name=hand_name(robot), size=[0.02] * 3)
    weld = spec.add_equality(
        name=robot,
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1=hand_name(robot),
        name2=robot,
        solref=[_WELD_TIME, 1.0],
        solimp=[0.9999, 0.9999, 0.001, 0.5, 2.0],
    )
    weld.data[10] = 1.0  # torque scale: rotations have the same weight as translations


def add_wrist_sensors(spec: mujoco.MjSpec, robot: str) -> None:
    """Add a wrist's force and torque sensors: the wrench of the arm on the hand, in the axes and about the origin of
    the hand's site. As the hand has no mass, it is also the wrench on the payload.
    """
    for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
        spec.add_sensor(
            name=f"{robot}_{kind.name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=hand_name(robot)
        )


def joint_addresses(model: mujoco.MjModel, robot: str) -> tuple[Array, Array]:
    """Return the indices of an arm's joints in ``qpos`` and in ``qvel``, each (7,)."""
    joints = [model.joint(joint_name(robot, number)) for number in range(JOINTS)]
    return np.array([j.qposadr[0] for j in joints]), np.array([j.dofadr[0] for j in joints])
