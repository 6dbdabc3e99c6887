"""Recordings of random teams: robots, load, motion, noise, rate, and measurements."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.recording import Recording, RobotRecord, Truth
from coheft.estimation.batch.signals import low_pass
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.mass_properties import Inertia

Kind = Literal["white", "quantised", "filtered", "vibrating", "flexing"]
KINDS: tuple[Kind, ...] = ("white", "quantised", "filtered", "vibrating", "flexing")
RATES = (50.0, 100.0, 200.0, 500.0)
_STEP = 1e-4
_APART = 0.25
"""Shortest distance between two grasps [m]."""


@dataclass(frozen=True, eq=False)
class Team:
    """A random team, with exact samples.

    Attributes:
        rng: Random numbers for later draws.
        records: Exact samples, by robot.
        noise: Standard deviations of positions [m], rotations [rad], forces [N], torques [N·m].
        rate: Samples per second.
        truth: The load and the grasps.
        down: Gravity in each robot's grasp frame, shape (N, n, 3).
        yaws: Yaw of the world in each robot's home frame.
    """

    rng: np.random.Generator
    records: dict[str, RobotRecord]
    noise: Array
    rate: float
    truth: Truth
    down: Array
    yaws: tuple[Rotation, ...]


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number with a uniform logarithm."""
    return float(low * (high / low) ** rng.random())


def direction(rng: np.random.Generator) -> Array:
    """Draw a unit vector (3,)."""
    drawn = rng.normal(size=3)
    return drawn / np.linalg.norm(drawn)


def draw_team(seed: int, change: tuple[float, Inertia] | None = None) -> Team:
    """Draw a team of two to four robots.

    Args:
        seed: The seed.
        change: A load that is added: the time as a share of the recording, and its inertia relative to the load's
            mass.
    """
    rng = np.random.default_rng(seed)
    count, seconds, rate = int(rng.choice([2, 3, 3, 4])), rng.uniform(20.0, 60.0), float(rng.choice(RATES))
    mass, size = between(rng, 1.5, 20.0), rng.uniform(0.2, 0.9, 3)
    inertia = np.diag(mass / 12.0 * (size @ size - size**2))
    load = Inertia(mass, rng.uniform(-0.1, 0.1, 3), inertia)
    grasps: list[Pose] = []
    while len(grasps) < count:
        place = rng.uniform(0.2, 0.6) * direction(rng)
        if all(np.linalg.norm(place - other.translation) > _APART for other in grasps):
            grasps.append(Pose(Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix(), place))
    sizes, rates, phases = rng.uniform(0.1, 0.35, 3), rng.uniform(0.7, 2.8, (3, 3)), rng.uniform(0.0, 6.0, (3, 3))
    faster, moved = rng.uniform(0.0, 0.08, 3), rng.uniform(0.03, 0.1, 3)
    time = np.arange(int(seconds * rate)) / rate

    def at(t: Array) -> tuple[Rotation, Array]:
        slow, fast, shift = (np.sin(own * t[:, None] + phase) for own, phase in zip(rates, phases, strict=True))
        return Rotation.from_euler("xyz", sizes * slow + faster * fast), moved * shift

    turn, place = at(time)
    before, after = at(time - _STEP), at(time + _STEP)
    earlier, later = at(time - 2 * _STEP)[0], at(time + 2 * _STEP)[0]
    w = (before[0].inv() * after[0]).as_rotvec() / (2 * _STEP)
    alpha = ((turn.inv() * later).as_rotvec() - (earlier.inv() * turn).as_rotvec()) / (2 * _STEP) ** 2
    v = turn.inv().apply((after[1] - before[1]) / (2 * _STEP))
    a = turn.inv().apply((after[1] - 2 * place + before[1]) / _STEP**2 + [0.0, 0.0, 9.81])
    total = load.wrench(w, a, alpha)
    if change is not None:
        more = Inertia(mass * change[1].mass, change[1].com, mass * change[1].tensor)
        total += (time >= change[0] * seconds)[:, None] * more.wrench(w, a, alpha)
    share, push = rng.dirichlet(np.full(count, 6.0)), between(rng, 0.3, 6.0) * np.repeat([1.0, 0.1], 3)
    pushes = rng.normal(size=(count, 6)) * push
    pushes -= pushes.mean(axis=0)
    waves = np.sin(rng.uniform(0.4, 1.6, 6) * time[:, None] + rng.uniform(0.0, 6.0, 6))
    records, downs, yaws = {}, [], []
    for k, grasp in enumerate(grasps):
        yaw = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
        lever, own = grasp.translation, Rotation.from_matrix(grasp.rotation)
        pose = np.hstack(
            [yaw.apply(place + turn.apply(lever) - rng.uniform(-1.5, 1.5, 3)), (yaw * turn * own).as_quat()]
        )
        grasp_v, grasp_a = v + np.cross(w, lever), a + np.cross(alpha, lever) + np.cross(w, np.cross(w, lever))
        felt = (share[k] * total + pushes[k] * waves) @ np.linalg.inv(grasp.adjoint()).T
        twist = np.hstack([w, grasp_v]) @ np.kron(np.eye(2), grasp.rotation)
        records[f"r{k + 1}"] = RobotRecord(time, pose, twist, None, grasp_a @ grasp.rotation, felt)
        yaws.append(yaw)
        downs.append((yaw * turn * own).inv().apply(np.tile([0.0, 0.0, -9.81], (len(time), 1))))
    first = grasps[0].inverse()
    truth = Truth(tuple(first @ grasp for grasp in grasps), ((0.0, load.transported(first)),))
    noise = np.array([between(rng, *sizes) for sizes in ((3e-5, 5e-4), (5e-5, 1e-3), (0.03, 0.5), (0.003, 0.05))])
    return Team(rng, records, noise * np.sqrt(rate / 100.0), rate, truth, np.array(downs), tuple(yaws))


def recorded(team: Team, kind: Kind, *, by_twists: bool) -> Recording:
    """Return a recording with noise: poses and wrenches, or twists, accelerations and wrenches."""
    rng = team.rng
    at, turn, force, moment = team.noise
    of_motion = np.repeat([5e-3, 1e-2], 3), np.full(3, 0.05)
    robots = {}
    for name, robot in team.records.items():
        pose, twist, acceleration, wrench = robot.channels.values()  # there is no dtwist
        count, time = len(pose), robot.time
        wrench = wrench + np.repeat([force, moment], 3) * rng.normal(size=(count, 6))
        turned = Rotation.from_quat(pose[:, 3:])
        place, by = pose[:, :3] + at * rng.normal(size=(count, 3)), turn * rng.normal(size=(count, 3))
        twist = twist + of_motion[0] * rng.normal(size=(count, 6))
        acceleration = acceleration + of_motion[1] * rng.normal(size=(count, 3))
        match kind:
            case "quantised":
                steps = np.repeat([1.5 * force, 1.5 * moment], 3)
                wrench, place = steps * np.rint(wrench / steps), 1e-4 * np.rint(place / 1e-4)
            case "filtered":
                wrench = low_pass(wrench, team.rate, 15.0)
            case "vibrating":
                shake = 3.0 * np.sin(2.0 * np.pi * rng.uniform(11.0, 20.0) * time[:, None] + rng.uniform(0, 6, 6))
                wrench = wrench + np.repeat([force, moment], 3) * shake
            case "flexing":
                bend = low_pass(rng.normal(size=(count, 6)), team.rate, 1.0)
                bend *= np.repeat([2e-4, 4e-4], 3) / bend.std(axis=0)
                place, by = place + turned.apply(bend[:, :3]), by + bend[:, 3:]
            case "white":
                pass
        pose = np.hstack([place, (turned * Rotation.from_rotvec(by)).as_quat()])
        robots[name] = (
            RobotRecord(time, None, twist, None, acceleration, wrench)
            if by_twists
            else RobotRecord(time, pose, wrench=wrench)
        )
    sizes = SensorNoise(5e-3, 1e-2, 0.05, float(force), float(moment)) if by_twists else None
    return Recording(robots, noise=sizes, truth=team.truth)


def with_record(team: Team, name: str, **channels: Array) -> Team:
    """Return the team with other channels of one robot."""
    return replace(team, records={**team.records, name: replace(team.records[name], **channels)})
