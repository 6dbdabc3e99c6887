"""A run of three robots whose outcome is known by construction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec
import numpy as np

from coheft.app.results.record import Record
from coheft.app.results.report import Report, build_report
from coheft.estimation.geometry.spatial import Array, Pose, quaternion_from_rotation
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.structs import Estimate, LoadChangeNotice, PayloadEstimate, PoseEstimate, Validity
from coheft.wire.messages.truth import LoadState, PayloadTruth, Scene, Truth
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Sensors
from tests.estimation.team import random_pose

BLOCK = 0.02
ROBOTS = ["r1", "r2", "r3"]
GRASPS = {name: random_pose(np.random.default_rng(k)) for k, name in enumerate(ROBOTS)}
SCENE = Scene(
    robots=ROBOTS,
    rotations=np.array([GRASPS[name].rotation for name in ROBOTS]),
    translations=np.array([GRASPS[name].translation for name in ROBOTS]),
    neighbours={"r1": ["r2"], "r2": ["r1", "r3"], "r3": ["r2"]},
)
LIGHT = Inertia(10.0, np.array([0.1, -0.2, 0.05]), np.diag([0.5, 0.8, 1.1]))
HEAVY = Inertia(13.0, np.array([0.0, -0.1, 0.06]), np.diag([0.7, 0.9, 1.3]))
LOAD = LoadState(1, 3.0, (0.0, 0.1, 0.1), (0.1, 0.1, 0.1))
SCENARIO = msgspec.structs.replace(load_scenario("ring3"), name="test", sensors=Sensors(rate=500, block=10))
assert SCENARIO.block_duration == BLOCK
STD = np.array([0.1, 0.001, 0.002, 0.003, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06])


def built_report(record: Record) -> Report:
    """The report of a run in real time."""
    return build_report(SCENARIO, record, real_time_factor=1.0)


def total_wrench(block: int) -> Array:
    return np.array([np.sin(block), 3.0, np.cos(block), 0.5, -np.cos(block), 0.1])


def truth(block: int, payload: Inertia) -> Truth:
    """No two numbers of it are the same, so that none is taken for another."""
    rng = np.random.default_rng(block)
    pose = random_pose(rng, 0.3, 0.3)
    return Truth(
        block=block,
        time=(block + 1) * BLOCK,
        payload=PayloadTruth(payload.mass, payload.com, payload.tensor),
        loads=[LOAD] if payload is HEAVY else [],
        position=pose.translation,
        quaternion=quaternion_from_rotation(pose.rotation),
        total_wrench=total_wrench(block),
        samples=rng.normal(size=(3, 15)),
    )


def estimate(
    robot: str,
    block: int,
    payload: Inertia | None,
    *,
    converged: bool = True,
    changes: Sequence[LoadChangeNotice] = (),
    wrench_error: float = 0.0,
    pose_error: Pose | None = None,
    phase: Literal["poses", "inertia"] = "inertia",
) -> Estimate:
    """What a robot says that believes in ``payload``, given in the payload's frame."""
    carry = GRASPS[robot].inverse()
    believed = None
    if payload is not None:
        local = payload.transported(carry)
        believed = PayloadEstimate(local.mass, local.com, local.tensor, np.diag(STD**2))
    poses = {}
    for other in SCENE.neighbours[robot]:
        pose = carry @ GRASPS[other] @ (pose_error or Pose.identity())
        poses[other] = PoseEstimate(pose.rotation, pose.translation, np.eye(6))
    return Estimate(
        robot=robot,
        block=block,
        time=(block + 1) * BLOCK,
        phase=phase,
        estimator="fan2017",
        converged=converged,
        members=3,
        payload=believed,
        poses=poses,
        total_block=max(-1, block - 4),
        total_wrench=(1.0 + wrench_error) * carry.adjoint() @ total_wrench(block - 4),
        not_observable=[] if payload is not None else ["mass: too little motion"],
        load_changes=list(changes),
        status=Validity.VALID if payload is not None else Validity.STARTING,
    )


def recorded(
    truths: Sequence[Truth], estimates: Mapping[str, Sequence[Estimate]], *, with_history: bool = False
) -> Record:
    """What an observer keeps that hears each truth before the estimates about it."""
    record = Record(SCENE, truths[-1].time, with_history=with_history)
    remaining = sorted((each for series in estimates.values() for each in series), key=lambda each: each.block)
    for truth in truths:
        record.receive(truth)
        while remaining and remaining[0].block <= truth.block:
            record.receive(remaining.pop(0))
    for each in remaining:
        record.receive(each)
    return record


def changing_run(
    recovers_at: dict[str, int], notices: dict[str, float]
) -> tuple[list[Truth], dict[str, list[Estimate]]]:
    """The load changes at block 100 of 200; each robot believes the old one until its own block."""
    truths = [truth(block, LIGHT if block < 100 else HEAVY) for block in range(200)]
    estimates = {}
    for robot in ROBOTS:
        notice = notices.get(robot)
        changes = [LoadChangeNotice(noticed_at=notice, changed_at=2.0)] if notice is not None else []
        estimates[robot] = [
            estimate(
                robot,
                block,
                LIGHT if block < recovers_at[robot] else HEAVY,
                changes=changes if notice is not None and (block + 1) * BLOCK >= notice else [],
            )
            for block in range(200)
        ]
    return truths, estimates
