"""Simulated experiments with mocobots."""

from collections.abc import Mapping, Sequence
from itertools import islice

import numpy as np
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from coheft.app.study.samples import ReferenceOf, agents_references, reference_blocks
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.smooth_step import cubic_step
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.physics_server.data_recorder import DataRecorder
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.motion import ViaPoints
from coheft.wire.scenario.schema import Scenario

SPHERE_TIME = 60.0
"""Duration of the periodic motion [s]."""
_RAMP = 2.0
_SWING_DEG = 11.0
"""Amplitude per axis [degrees]."""
_FREQUENCIES = ((0.35, 0.55), (0.40, 0.65), (0.45, 0.70))
"""Two frequencies per axis [Hz]."""
_DERIVATIVE_STEP = 1e-4


def record(scenario: Scenario, references: Mapping[str, ReferenceOf] | None = None) -> Recording:
    """Simulate a recording with these references by robot; None for those of the scenario's agents."""
    simulation = Simulation(scenario)
    recorder = DataRecorder(scenario, simulation.scene)
    for result in islice(reference_blocks(scenario, simulation, references), scenario.blocks):
        recorder.add(result)
    return recorder.recording()


def record_sphere(scenario: Scenario) -> Recording:
    """Simulate a periodic motion on a sphere (Zhang et al., sec. IV-C), then the scenario's holds.

    The three grasps lie on a meridian of the sphere, and rotate about its centre. Grasp poses are known, as from a
    previous experiment.
    """
    via = scenario.motion.via_points or ViaPoints()
    moving = replace(scenario.motion, via_points=replace(via, count=2))
    rest = 2 * (np.mean(via.transit) + np.mean(via.dwell)) + via.holds * (via.hold_transit + via.hold_time)
    shifted = replace(scenario, motion=moving, duration=SPHERE_TIME + float(rest) + 2.0)
    block_rate = scenario.sensors.rate / scenario.sensors.block
    first = round(SPHERE_TIME * block_rate)
    after = agents_references(shifted)
    sphere = sphere_references(scenario.robots.poses(), scenario.seed, scenario.sensors.rate, scenario.sensors.block)

    def joined(turning: ReferenceOf, holding: ReferenceOf) -> ReferenceOf:
        return lambda block: turning(block) if block < first else holding(block - first)

    names = scenario.robot_names
    return record(shifted, {name: joined(turn, after[name]) for name, turn in zip(names, sphere, strict=True)})


def sphere_references(grasps: Sequence[Pose], seed: int, rate: int, block: int) -> list[ReferenceOf]:
    """References for a rotation of the load about the centre of the circle through three grasps.

    The home frames are at the grasp poses; ``seed`` determines the phases, ``block`` is the number of samples in one.
    """
    centre = circumcentre(np.array([grasp.translation for grasp in grasps[:3]]))
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, size=(3, 2))
    omegas = 2.0 * np.pi * np.array(_FREQUENCIES)

    def displacement(grasp: Pose, time: Array) -> Array:
        swing = 0.5 * np.radians(_SWING_DEG) * np.sin(omegas * time[:, None, None] + phases).sum(axis=-1)
        edge, _ = cubic_step(np.clip(np.minimum(time, SPHERE_TIME - time) / _RAMP, 0.0, 1.0)[:, None])
        turned = Rotation.from_rotvec(edge * swing).apply(grasp.translation - centre)
        return (turned - (grasp.translation - centre)) @ grasp.rotation

    def reference(grasp: Pose) -> ReferenceOf:
        def at(index: int) -> Array:
            time = (index * block + np.arange(block)) / rate
            motion = np.zeros((block, 12))
            motion[:, 3:6] = displacement(grasp, time)
            before, after = displacement(grasp, time - _DERIVATIVE_STEP), displacement(grasp, time + _DERIVATIVE_STEP)
            motion[:, 9:] = (after - before) / (2.0 * _DERIVATIVE_STEP)
            return motion

        return at

    return [reference(grasp) for grasp in grasps]


def circumcentre(points: Array) -> Array:
    """Centre (3,) of the circle through three points (3, 3)."""
    a, b = points[0] - points[2], points[1] - points[2]
    normal = np.cross(a, b)
    lever: Array = np.cross((a @ a) * b - (b @ b) * a, normal) / (2.0 * normal @ normal)
    centre: Array = lever + points[2]
    return centre
