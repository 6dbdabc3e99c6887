"""Recordings with one fault of random size, with the robot and the causes that a verdict may name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.drawn_recordings import Team, between, direction, draw_team, recorded, with_record
from coheft.estimation.batch.plausibility import inverse_poses, turned_poses
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.batch.signals import without_jumps
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import Inertia

Change = Callable[[RobotRecord], dict[str, Array]]


@dataclass(frozen=True, eq=False)
class Faulty:
    """A recording with a fault, the causes that are right, and the robot with the fault.

    There is no cause if the recording has to be refused, and no robot if the fault concerns all robots, or none.
    """

    recording: Recording
    causes: tuple[str, ...]
    robot: str | None


def pose_of(robot: RobotRecord) -> Array:
    """Poses of a robot that recorded them."""
    assert robot.pose is not None
    return robot.pose


def wrench_of(robot: RobotRecord) -> Array:
    """Wrenches of a robot that recorded them."""
    assert robot.wrench is not None
    return robot.wrench


def _both(rotation: Rotation, wrench: Array) -> Array:
    return np.hstack([rotation.apply(wrench[:, :3]), rotation.apply(wrench[:, 3:])])


def _late(robot: RobotRecord, delay: float, channels: Sequence[str]) -> dict[str, Array]:
    moved: dict[str, Array] = {}
    for channel in channels:
        samples: Array = getattr(robot, channel)
        if channel == "pose":
            samples = without_jumps(samples)
        moved[channel] = CubicSpline(robot.time, samples)(robot.time - delay)
        if channel == "pose":
            moved[channel][:, 3:] /= np.linalg.norm(moved[channel][:, 3:], axis=1, keepdims=True)
    return moved


def _slipped(robot: RobotRecord, when: float, shift: Array, turn: Array) -> dict[str, Array]:
    on = (robot.time >= when)[:, None]
    step, by = on * shift, Rotation.from_rotvec(on * turn)
    own, wrench = Rotation.from_quat(pose_of(robot)[:, 3:]), wrench_of(robot)
    pose = np.hstack([pose_of(robot)[:, :3] + own.apply(step), (own * by).as_quat()])
    moment = wrench[:, 3:] - np.cross(step, wrench[:, :3])
    return {"pose": pose, "wrench": _both(by.inv(), np.hstack([wrench[:, :3], moment]))}


LISTED = (
    *("offset", "tared", "drift", "lever", "lever of all", "scale", "sign", "moment unit", "moment unit of all"),
    *("base axes", "base axes of all", "turned", "exchanged", "wrench clock", "wrench clock of all", "clock"),
    *("compensated", "load change", "slip", "not level", "tilted", "inverse", "inverse of all", "quaternions"),
    *("dead", "frozen", "length scale", "swapped"),
)
UNLISTED = ("crosstalk", "saturation", "one axis", "clock rate", "two")
CAUSES: dict[str, tuple[str, ...]] = {
    "offset": ("offset",),
    "tared": ("offset",),
    "drift": ("drift",),
    "lever": ("lever",),
    "scale": ("scale", "force scale"),
    "sign": ("scale", "sensor turned"),
    "moment unit": ("moment scale",),
    "base axes": ("base axes",),
    "turned": ("sensor turned",),
    "exchanged": ("sensor turned",),
    "wrench clock": ("clock",),
    "clock": ("clock",),
    "compensated": ("weight compensated",),
    "slip": ("slip",),
    "not level": ("gravity", "homes not level"),
    "tilted": ("gravity", "homes not level"),
    "load change": ("load change",),
    "inverse": ("inverse poses",),
    "dead": ("sensor dead",),
    "frozen": ("sensor dead",),
    "length scale": ("length scale",),
    "swapped": ("robots swapped",),
}
"""Right causes of faults; other faults have to be refuted or refused without one."""
_BY_POSES = {"base axes", "base axes of all", "compensated", "slip", "not level", "tilted", "inverse", "inverse of all"}
_BY_POSES |= {"quaternions", "length scale"}


def faulty(kind: str, seed: int, *, by_twists: bool) -> Faulty:
    """Return a recording with a fault of random size, robot and time."""
    rng = np.random.default_rng([1, seed])
    change = None
    if kind == "load change":
        mass = between(rng, 0.003, 0.5)
        change = (rng.uniform(0.25, 0.75), Inertia(mass, rng.uniform(-0.25, 0.25, 3), 0.002 * mass * np.eye(3)))
    team = draw_team(seed, change)
    by_twists = by_twists and kind not in _BY_POSES
    one = str(rng.choice(list(team.records)))
    if kind == "swapped":
        return Faulty(_swapped(recorded(team, "white", by_twists=by_twists), one, rng), CAUSES[kind], None)
    names = list(team.records) if kind.endswith(" of all") or kind in ("tared", "tilted", "compensated") else [one]
    robot = one if len(names) == 1 and kind != "load change" else None
    kinds = [kind]
    if kind == "two":
        kinds = [
            str(name) for name in rng.choice(["offset", "lever", "turned", "wrench clock", "scale"], 2, replace=False)
        ]
    for each in kinds:
        fault = _fault(team, each.removesuffix(" of all"), names, rng, by_twists=by_twists)
        team = fault if isinstance(fault, Team) else team
        recording = recorded(team, "white", by_twists=by_twists)
        if not isinstance(fault, Team):
            robots = {k: replace(r, **fault(r)) if k in names else r for k, r in recording.robots.items()}
            recording = replace(recording, robots=robots)
    return Faulty(recording, CAUSES.get(kinds[-1].removesuffix(" of all"), ()), robot)


def _swapped(recording: Recording, one: str, rng: np.random.Generator) -> Recording:
    """Give the wrenches of one robot to another, and the other way round."""
    other = str(rng.choice([name for name in recording.names if name != one]))
    robots = dict(recording.robots)
    for own, given in ((one, other), (other, one)):
        robots[own] = replace(robots[own], wrench=recording.robots[given].wrench)
    return replace(recording, robots=robots)


def _fault(team: Team, kind: str, names: Sequence[str], rng: np.random.Generator, *, by_twists: bool) -> Team | Change:
    """Return the team with a fault before noise, or the change of each robot's record after noise."""
    end = float(team.records[names[0]].time[-1])
    when, sign = rng.uniform(0.25, 0.75) * end, float(rng.choice([-1.0, 1.0]))
    motion = ("twist", "acceleration") if by_twists else ("pose",)

    def before(change: Change) -> Team:
        changed = team
        for name in names:
            changed = with_record(changed, name, **change(team.records[name]))
        return changed

    def to_wrench(change: Callable[[Array], Array]) -> Change:
        return lambda robot: {"wrench": change(wrench_of(robot))}

    match kind:
        case "offset":
            size = between(rng, 0.01, 6.0)
            off = size * np.hstack([direction(rng), 0.05 * direction(rng)])
            return before(to_wrench(lambda wrench: wrench + off))
        case "tared":
            first = int(0.2 * team.rate)
            return to_wrench(lambda wrench: wrench - wrench[:first].mean(axis=0))
        case "drift":
            off = between(rng, 0.1, 5.0) * np.hstack([direction(rng), 0.05 * direction(rng)])
            return before(to_wrench(lambda w: w + np.linspace(-0.5, 1.0, len(w))[:, None] * off))
        case "lever":
            arm = between(rng, 0.001, 0.12) * direction(rng)
            moved = to_wrench(lambda w: np.hstack([w[:, :3], w[:, 3:] + np.cross(arm, w[:, :3])]))
            return before(moved)
        case "scale":
            factor = 1.0 + sign * between(rng, 0.001, 0.3)
            return before(to_wrench(lambda wrench: factor * wrench))
        case "sign":
            return before(to_wrench(lambda wrench: -wrench))
        case "moment unit":
            unit = np.repeat([1.0, float(rng.choice([1000.0, 100.0, 0.1019716]))], 3)
            return to_wrench(lambda wrench: wrench * unit)
        case "base axes":
            return before(lambda r: {"wrench": _both(Rotation.from_quat(pose_of(r)[:, 3:]), wrench_of(r))})
        case "turned":
            turn = Rotation.from_rotvec(np.radians(between(rng, 1.0, 150.0)) * direction(rng))
            return before(to_wrench(lambda wrench: _both(turn, wrench)))
        case "exchanged":
            axes = [[0, 2, 1], [1, 0, 2], [2, 1, 0], [1, 2, 0]][int(rng.integers(4))]
            return before(to_wrench(lambda w: w[:, [*axes, *(3 + k for k in axes)]]))
        case "wrench clock":
            delay = sign * between(rng, 0.001, 0.1)
            return before(lambda robot: _late(robot, delay, ["wrench"]))
        case "clock":
            delay = sign * between(rng, 0.001, 0.1)
            return before(lambda robot: _late(robot, delay, [*motion, "wrench"]))
        case "compensated":
            load = team.truth.loads[0][1]
            changed = team
            for name, down, own_pose in zip(names, team.down, team.truth.poses, strict=True):
                weight = load.mass / len(names) * down
                centre = own_pose.rotation.T @ (load.com - own_pose.translation)
                own = np.hstack([weight, np.cross(centre, weight)])
                changed = with_record(changed, name, wrench=wrench_of(team.records[name]) + own)
            return changed
        case "slip":
            shift, turn_by = between(rng, 5e-4, 0.02) * direction(rng), between(rng, 1e-3, 0.05) * direction(rng)
            return before(lambda robot: _slipped(robot, when, shift, turn_by))
        case "not level" | "tilted":
            angle = rng.uniform(0.0, 2.0 * np.pi)
            size = np.radians(between(rng, 0.1, 90.0 if kind == "not level" else 30.0))
            turn = Rotation.from_rotvec(size * np.array([np.cos(angle), np.sin(angle), 0.0]))
            changed = team
            for name in names:
                yaw = team.yaws[list(team.records).index(name)]
                pose = turned_poses(pose_of(team.records[name]), yaw * turn * yaw.inv())
                changed = with_record(changed, name, pose=pose)
            return changed
        case "load change":
            return team
        case "inverse":
            return lambda robot: {"pose": inverse_poses(pose_of(robot))}
        case "quaternions":
            return lambda robot: {"pose": pose_of(robot)[:, [0, 1, 2, 6, 3, 4, 5]]}
        case "dead":
            return to_wrench(lambda w: 0.0 * w + 1e-3 * rng.normal(size=w.shape))
        case "frozen":
            start = int(when * team.rate)
            return to_wrench(lambda w: np.vstack([w[:start], np.tile(w[start], (len(w) - start, 1))]))
        case "crosstalk":
            mixed = np.eye(6) + between(rng, 0.01, 0.1) * rng.normal(size=(6, 6))
            return before(to_wrench(lambda wrench: wrench @ mixed.T))
        case "saturation":
            limit = rng.uniform(0.3, 0.8)
            return before(to_wrench(lambda w: np.clip(w, -limit * np.abs(w).max(0), limit * np.abs(w).max(0))))
        case "one axis":
            lost = int(rng.integers(3))
            return before(to_wrench(lambda w: w * (np.arange(6) != lost)))
        case "clock rate":
            drifting = sign * between(rng, 3e-4, 5e-3)
            return before(
                lambda r: {"wrench": CubicSpline(r.time, wrench_of(r))(np.clip(r.time * (1 + drifting), 0, end))}
            )
        case "length scale":
            ruler = 1.0 + sign * between(rng, 0.005, 0.05)
            return before(lambda r: {"pose": pose_of(r) * np.repeat([ruler, 1.0], [3, 4])})
        case _:
            raise ValueError(f"expected one of {LISTED + UNLISTED}, found {kind!r}")
