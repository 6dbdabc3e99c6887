"""How well a load was carried along the common path: deviations from the path, and internal forces."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from coheft.agents.motion.common_path import CommonPath
from coheft.app.results.record import load_ids, loads_since
from coheft.app.results.report import CarryPhaseReport, CarryReport, LoadDropReport
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp, rotation_from_quaternion, rotation_log
from coheft.estimation.measurement import WRENCH
from coheft.estimation.rigid_body.feedforward import internal_wrenches
from coheft.physics_server.scene import PAYLOAD_HOME
from coheft.wire.messages.truth import Scene, Truth
from coheft.wire.scenario.schema import Scenario

SETTLING = 2.0
"""Time after the start of feed-forward, or after a load change, at which the next phase begins [s]."""
PROMISED = 5.0
"""Factor by which feed-forward reduces the deviation from the path."""

_What = Literal["alone", "springs", "feedforward"]


@dataclass(eq=False)
class _Sums:
    """Sums of squares in a phase: deviation from the path [m, rad], internal forces and torques [N, N·m]."""

    begin: float
    end: float = 0.0
    squares: Array = field(default_factory=lambda: np.zeros(4))
    count: int = 0

    @property
    def rms(self) -> Array:
        """Root mean squares."""
        return np.sqrt(self.squares / self.count)


@dataclass(eq=False)
class _Drop:
    """A load change: its time, the largest deviation from the path since [m], the last time it was too large [s]."""

    at: float
    mass: float
    largest: float = 0.0
    last_exceeded: float | None = None


class CarryRecord:
    """Evaluates a run that carries its load along the common path of its scenario."""

    def __init__(self, scenario: Scenario, scene: Scene) -> None:
        assert scenario.carry is not None
        self._scenario = scenario
        self._carry = scenario.carry
        self._path = CommonPath(self._carry, self._carry.start)
        self._grasps = [Pose(r, p) for r, p in zip(scene.rotations, scene.translations, strict=True)]
        self._loads: list[int] | None = None
        self._changed_at = -np.inf
        self._phases: dict[tuple[_What, int], _Sums] = {}
        self._drops: list[_Drop] = []

    def add(self, truth: Truth) -> None:
        """Add the truth of one more block."""
        block_duration = self._scenario.block_duration
        loads = load_ids(truth)
        if self._loads is not None and loads != self._loads:
            self._changed_at = loads_since(truth)
            self._drops.append(_Drop(self._changed_at, truth.payload.mass))
        self._loads = loads
        off = self.error(truth)
        pushed = np.square(internal_wrenches(truth.samples[:, WRENCH], self._grasps))
        # For a single robot: root mean square over the robots of the vectors' lengths.
        lengths = pushed.reshape(-1, 2, 3).sum(axis=2).mean(axis=0)
        phase = self._phase(truth.time)
        if phase is not None:
            sums = self._phases.setdefault((phase, len(self._drops)), _Sums(truth.time - block_duration))
            sums.squares += np.concatenate([np.square(off), lengths])
            sums.count += 1
            sums.end = truth.time
        if self._drops and truth.time > self._path.full_from:
            drop, limit = self._drops[-1], self._limit()
            drop.largest = max(drop.largest, float(off[0]))
            if limit is not None and off[0] > limit:
                drop.last_exceeded = truth.time

    def error(self, truth: Truth) -> Array:
        """Return the deviation of the payload's frame from the path: distance [m], angle [rad], shape (2,)."""
        rate = self._scenario.sensors.rate
        time = np.array([truth.time - 1.0 / rate])  # of the block's last sample
        displacement = self._path.displacement(time)[0][0]
        moved = Pose(rotation_exp(displacement[:3]), displacement[3:])
        reference = self._grasps[0]
        wanted = PAYLOAD_HOME @ reference @ moved @ reference.inverse()
        turn = rotation_log(wanted.rotation.T @ rotation_from_quaternion(truth.quaternion))
        return np.array([np.linalg.norm(truth.position - wanted.translation), np.linalg.norm(turn)])

    def _phase(self, time: float) -> _What | None:
        """Return the phase at a time, None during a transition."""
        carry, motion = self._carry, self._scenario.motion
        if time <= carry.start:
            return "alone" if time > motion.ramp else None
        if time <= self._path.full_from or time <= self._changed_at + SETTLING:
            return None
        if not carry.feedforward or time <= carry.feedforward_at:
            return "springs"
        return "feedforward" if time > carry.feedforward_at + SETTLING else None

    def _limit(self) -> float | None:
        """Return the largest deviation that counts as back on the path [m]; None without the phase ``springs``."""
        springs = next((sums for (what, _), sums in self._phases.items() if what == "springs"), None)
        return None if springs is None else float(springs.rms[0]) / PROMISED

    def report(self) -> CarryReport:
        """Return the report of the run so far."""
        noise_force, noise_torque = self._noise()
        return CarryReport(
            phases=[_phase_report(what, sums) for (what, _), sums in self._phases.items()],
            drops=[self._drop_report(drop) for drop in self._drops],
            noise_force_n=float(noise_force),
            noise_torque_nm=float(noise_torque),
        )

    def _drop_report(self, drop: _Drop) -> LoadDropReport:
        last = max((sums.end for sums in self._phases.values()), default=0.0)
        back = drop.at if drop.last_exceeded is None else drop.last_exceeded
        is_back = self._carry.feedforward and self._limit() is not None and back < last
        return LoadDropReport(
            at_s=round(drop.at, 9),
            mass=drop.mass,
            largest_mm=1e3 * drop.largest,
            back_after_s=round(back - drop.at, 9) if is_back else None,
        )

    def _noise(self) -> Array:
        """Return the internal force and torque that sensor noise alone would cause [N, N·m]."""
        count = len(self._grasps)
        noise = self._scenario.noise
        deviation = np.tile(np.repeat([noise.force, noise.torque], 3), count)
        spread = internal_wrenches(np.diag(deviation).reshape(-1, count, 6), self._grasps)
        squares = np.square(spread).sum(axis=0).reshape(count, 2, 3).sum(axis=2)
        deviations: Array = np.sqrt(squares.mean(axis=0))
        return deviations


def _phase_report(what: _What, sums: _Sums) -> CarryPhaseReport:
    position, rotation, force, torque = sums.rms.tolist()
    is_common = what != "alone"
    return CarryPhaseReport(
        what=what,
        from_s=round(sums.begin, 9),
        to_s=round(sums.end, 9),
        position_rms_mm=1e3 * position if is_common else None,
        rotation_rms_deg=float(np.degrees(rotation)) if is_common else None,
        internal_force_rms_n=force,
        internal_torque_rms_nm=torque,
    )
