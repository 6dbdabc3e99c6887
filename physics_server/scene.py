"""The scene: a free payload, the robots' grasps on it, and what the engine needs to simulate them."""

from collections.abc import Sequence

import mujoco
import numpy as np

from coheft.estimation.geometry.spatial import Pose, quaternion_from_rotation, rotation_exp
from coheft.physics_server.arms.impedance import add_arm
from coheft.physics_server.arms.model import add_seven_joint_arm, add_wrist_sensors, hand_name
from coheft.physics_server.loads import add_slots
from coheft.physics_server.sensor_errors import SensorErrors
from coheft.physics_server.sensors import add_sensors
from coheft.wire.scenario.payload import MassProperties, Payload
from coheft.wire.scenario.schema import PHYSICS_RATE, Scenario

PAYLOAD_HOME = Pose(np.eye(3), np.array([0.0, 0.0, 1.0]))
"""Initial pose of the payload's frame in the world. The robots' home frames are the initial poses of their grasps."""

PAYLOAD = "payload"


def home_name(robot: str) -> str:
    """Return the name of the site of the robot's home frame; the grasp site has the robot's own name."""
    return f"{robot}_home"


def build_model(scenario: Scenario, grasps: Sequence[Pose], errors: SensorErrors) -> mujoco.MjModel:
    """Compile the scene. Nothing collides, and welds are the only constraints."""
    spec = mujoco.MjSpec()
    spec.modelname = scenario.name
    spec.option.timestep = 1.0 / PHYSICS_RATE
    disable = mujoco.mjtDisableBit
    # Without the automatic reset, a payload that diverges is noticed; the engine would silently restart.
    spec.option.disableflags = disable.mjDSBL_CONTACT | disable.mjDSBL_AUTORESET
    has_joints = scenario.robots.arms == "seven-joint"
    if has_joints:
        # With Euler's method, hands drift off the payload by about h² per step. Welds correct this by a motion that the
        # payload does not have, and joint damping would make the arms move unlike the accelerometers' readings.
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    else:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        spec.option.disableflags |= disable.mjDSBL_CONSTRAINT
    payload = _add_payload(spec, scenario.payload)
    add_slots(payload, scenario.payload.load_slots)
    for number, (robot, grasp) in enumerate(zip(scenario.robot_names, grasps, strict=True)):
        places = {"velocity": errors.velocity_places[number], "acceleration": errors.acceleration_places[number]}
        _add_site(payload, robot, grasp)
        _add_site(spec.worldbody, home_name(robot), PAYLOAD_HOME @ grasp)
        if has_joints:
            add_seven_joint_arm(spec, robot, PAYLOAD_HOME @ grasp)
            add_sensors(spec, hand_name(robot), places)
        else:
            add_arm(spec, robot, home_name(robot), scenario.robots.stiffness, scenario.robots.damping)
            add_sensors(spec, robot, places)
    if has_joints:
        for robot in scenario.robot_names:
            add_wrist_sensors(spec, robot)
    return spec.compile()


def _add_payload(spec: mujoco.MjSpec, payload: Payload) -> mujoco.MjsBody:
    body = spec.worldbody.add_body(name=PAYLOAD, pos=PAYLOAD_HOME.translation)
    body.add_freejoint()
    if payload.properties is not None:
        body.explicitinertial = True
        body.mass = payload.properties.mass
        body.ipos = payload.properties.com
        body.inertia = _moments(payload.properties)
        body.iquat = quaternion_from_rotation(rotation_exp(np.radians(payload.properties.axes_deg)))
    for box in payload.boxes:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=np.array(box.size) / 2.0,
            pos=box.position,
            quat=quaternion_from_rotation(box.pose().rotation),
            mass=box.mass,
            contype=0,
            conaffinity=0,
        )
    return body


def _moments(properties: MassProperties) -> list[float]:
    """Return principal moments that the engine accepts: the largest at most the sum of the others, without rounding."""
    small, middle, large = np.argsort(properties.principal)
    moments = list(properties.principal)
    moments[large] = min(moments[large], moments[small] + moments[middle])
    return moments


def _add_site(body: mujoco.MjsBody, name: str, pose: Pose) -> None:
    body.add_site(name=name, pos=pose.translation, quat=quaternion_from_rotation(pose.rotation), size=[0.02] * 3)
