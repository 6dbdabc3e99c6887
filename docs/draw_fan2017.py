"""Draws the pictures of fan2017.md: figures 2, 3 and 4 of Fan et al. (CDC 2017), and the robots' disagreement.

One run of ``configs/fan2017.toml`` in this process, a minute or two. Needs coheft[study].
"""

from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from drawing import AXES, INK, PICTURES, ROBOTS, SOFT, save
from matplotlib.figure import Figure

from coheft.agents.estimator import Belief
from coheft.app.results.judge import Judge
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.consensus.graph import Neighbours
from coheft.estimation.geometry.spatial import Array, Pose, rotation_log
from coheft.estimation.rigid_body.mass_properties import Inertia, pack_symmetric, unpack_symmetric
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario

_TRUTH = {"color": "#111418", "linewidth": 1.0, "linestyle": (0, (5, 3)), "zorder": 4}
_NAMES = ("m, kg", "h x, m", "h y, m", "h z, m", *(f"J {each}, kg·m²" for each in ("xx", "yy", "zz", "xy", "xz", "yz")))
_REACH = (4.0, *(0.15,) * 3, *(0.6,) * 6)
"""Range of the vertical axes around the truth, without the first estimates."""
_EVERY = 4
"""Number of blocks between two points of a line."""


@dataclass(frozen=True, eq=False)
class Run:
    """The truth of a run, and every robot's belief after each block."""

    scenario: Scenario
    graph: Neighbours
    judge: Judge
    truths: Sequence[Truth]
    beliefs: Sequence[dict[str, Belief]]

    @property
    def times(self) -> Array:
        """Ends of all blocks, shape (blocks,) [s]."""
        return np.array([truth.time for truth in self.truths])

    @property
    def change(self) -> float:
        """Time of the load change [s]."""
        return self.scenario.load_changes[0].at

    @property
    def start(self) -> float:
        """Time at which poses have converged and the inertial phase begins [s]."""
        begun = [belief["r1"].phase == "inertia" for belief in self.beliefs]
        return float(self.times[begun.index(True)])

    @cached_property
    def adopted(self) -> list[int]:
        """Blocks at which all robots started their sums, with their poses of that time."""
        newest = np.array([belief["r1"].total_block for belief in self.beliefs])
        waits = np.diff(newest, prepend=newest[0]) == 0
        anew = np.flatnonzero(waits[1:] & ~waits[:-1]) + 1
        return [int(np.searchsorted(self.times, self.start)), *anew.tolist()]

    def pose_in_use(self, robot: str, neighbour: str, block: int) -> Pose:
        """Return the pose of a neighbour that is used for the sums."""
        before = max((each for each in self.adopted if each <= block), default=self.adopted[0])
        return self.beliefs[before][robot].poses[neighbour].pose

    @cached_property
    def bodies(self) -> Array:
        """Each robot's m, h and J in the payload's frame, (robots, blocks, 10); NaN where unknown."""
        robots = self.judge.scene.robots
        result = np.full((len(robots), len(self.beliefs), 10), np.nan)
        for k, robot in enumerate(robots):
            to_payload = self.judge.pose_payload_in(robot, -1).inverse()
            for row, beliefs in enumerate(self.beliefs):
                payload = beliefs[robot].payload
                if payload is not None and payload.com is not None and payload.tensor is not None:
                    found = Inertia(payload.mass, payload.com, payload.tensor)
                    result[k, row] = _of_body(found.transported(to_payload))
        return result

    @cached_property
    def bodies_true(self) -> Array:
        """The true m, h and J, (blocks, 10)."""
        return np.array([_of_body(Inertia(t.mass, t.com, t.tensor)) for t in (each.payload for each in self.truths)])


def run(scenario: Scenario) -> Run:
    """Run the scenario in this process."""
    team = TeamInProcess(scenario)
    truths: list[Truth] = []
    beliefs: list[dict[str, Belief]] = []
    for _ in range(scenario.blocks):
        result = team.measure()
        team.answer(measured(result), team.received())
        truths.append(result.truth)
        beliefs.append({name: agent.belief() for name, agent in team.agents.items()})
    return Run(scenario, team.graph, Judge(team.simulation.scene, truths), truths, beliefs)


def main() -> None:
    """Draw all pictures."""
    parser = ArgumentParser(description="Draw the pictures of fan2017.md.")
    parser.add_argument("set", nargs="*", metavar="KEY=VALUE", help="change the scenario, as --set of coheft run does")
    parser.add_argument("--to", type=Path, default=PICTURES, metavar="DIR", help="folder for the pictures")
    given = parser.parse_args()
    given.to.mkdir(parents=True, exist_ok=True)
    found = run(load_scenario("fan2017", given.set))
    save_as = partial(save, folder=given.to)
    save_as(_draw_poses(found), "fan2017-poses.svg")
    save_as(_draw_payload(found, found.start - 1.0, found.start + 10.0), "fan2017-payload.svg")
    save_as(_draw_payload(found, found.change - 1.0, found.scenario.duration), "fan2017-change.svg")
    save_as(_draw_consensus(found), "fan2017-consensus.svg")
    print(f"poses were adopted at {', '.join(f'{found.times[block]:.1f}' for block in found.adopted)} s")
    print(f"all robots knew the body {_settled(found, found.start, found.change):.1f} s after that")
    print(f"and {_settled(found, found.change, found.scenario.duration):.1f} s after it had changed")


# --- figure 2 ---------------------------------------------------------------------------------------------------------


def _draw_poses(found: Run) -> Figure:
    edges = [(name, other) for name, others in found.graph.items() for other in others if name < other]
    shown = slice(0, int(np.searchsorted(found.times, found.start + 4.0)), _EVERY)
    times = found.times[shown]
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    halves = figure.add_gridspec(2, 1, height_ratios=(1.75, 1.0))
    components, errors = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    grid = components.subplots(2, len(edges), sharex=True, sharey="row")
    turned, moved = errors.subplots(1, 2)
    for k, (name, other) in enumerate(edges):
        truth = found.judge.relative_pose(name, other)
        known = [belief[name].poses.get(other) for belief in found.beliefs[shown]]
        poses = [Pose.identity() if each is None else each.pose for each in known]
        numbers = np.array([_numbers(pose) for pose in poses])
        for row, axes in enumerate(grid[:, k]):
            for axis in range(3):
                column = 3 * row + axis
                axes.plot(times, numbers[:, column], color=AXES[axis], linewidth=1.3, label="xyz"[axis])
                axes.axhline(_numbers(truth)[column], **_TRUTH)
            axes.axvline(found.start, color=SOFT, linewidth=0.9)
        grid[0, k].set_title(f"{other} in the frame of {name}", fontsize=9.5)
        off = np.array([_numbers(_off(truth, pose)) for pose in poses])
        line = {"color": ROBOTS[k], "linewidth": 1.3, "label": f"{name}-{other}"}
        turned.semilogy(times, np.linalg.norm(off[:, :3], axis=1), **line)
        moved.semilogy(times, 1e3 * np.linalg.norm(off[:, 3:], axis=1), **line)
    grid[0, 0].set_ylabel("rotation vector, °")
    grid[1, 0].set_ylabel("translation, m")
    grid[0, 0].legend(frameon=False, ncols=3, fontsize=8, handlelength=0.9, columnspacing=0.7, loc="upper left")
    for axes, label in ((turned, "rotation off by, °"), (moved, "translation off by, mm")):
        axes.set_ylabel(label)
        axes.set_xlabel("time, s")
        axes.set_xlim(0.0, times[-1])
        axes.axvline(found.start, color=SOFT, linewidth=0.9)
    turned.legend(frameon=False, ncols=3, fontsize=8.5)
    moved.text(found.start + 0.1, moved.get_ylim()[1], "poses are adopted", color=SOFT, va="top", fontsize=9)
    components.suptitle("Relative poses of all edges; dashed: the truth", x=0.01, ha="left", fontsize=11)
    return figure


def _numbers(pose: Pose) -> Array:
    """Return rotation vector [degrees] and translation [m], shape (6,)."""
    return np.concatenate([np.degrees(rotation_log(pose.rotation)), pose.translation])


def _off(truth: Pose, estimate: Pose) -> Pose:
    return Pose(truth.rotation.T @ estimate.rotation, estimate.translation - truth.translation)


# --- figures 3 and 4 --------------------------------------------------------------------------------------------------


def _draw_payload(found: Run, start: float, end: float) -> Figure:
    """Draw all robots' mass, centre of mass and inertia, transformed to the payload's frame."""
    every = _EVERY if end - start > 12.0 else 1
    inside = slice(int(np.searchsorted(found.times, start)), int(np.searchsorted(found.times, end)), every)
    times, truths = found.times[inside], found.bodies_true[inside]
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    for column, axes in enumerate(figure.subplots(2, 5, sharex=True).flat):
        for k, robot in enumerate(found.judge.scene.robots):  # one over the other, the later ones thinner
            width = 3.4 - 0.5 * k
            axes.plot(times, found.bodies[k, inside, column], color=ROBOTS[k], label=robot, linewidth=width)
        axes.plot(times, truths[:, column], **_TRUTH, drawstyle="steps-pre", label="truth")
        axes.set_title(_NAMES[column], fontsize=10)
        axes.set_xlim(start, end)
        axes.set_ylim(truths[:, column].min() - _REACH[column], truths[:, column].max() + _REACH[column])
        for event in (found.start, found.change):
            axes.axvline(event, color=SOFT, linewidth=0.9)
        if column >= 5:
            axes.set_xlabel("time, s")
    lines, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(lines, labels, frameon=False, ncols=7, loc="outside upper left", handlelength=1.4, columnspacing=1.2)
    return figure


def _of_body(inertia: Inertia) -> Array:
    """Return m, h and J, shape (10,)."""
    return np.concatenate([[inertia.mass], inertia.com, pack_symmetric(inertia.tensor)])


def _settled(found: Run, start: float, end: float) -> float:
    """Return the time after ``start`` from which all robots have m within 1 %, h within 10 mm, J within 10 % [s]."""
    inside = slice(int(np.searchsorted(found.times, start)), int(np.searchsorted(found.times, end)))
    truths, off = found.bodies_true[inside], found.bodies[:, inside] - found.bodies_true[inside]
    tensor = slice(4, 10)
    good = (np.abs(off[:, :, 0]) < 0.01 * truths[:, 0]) & (np.linalg.norm(off[:, :, 1:4], axis=2) < 0.010)
    good &= _norm(off[:, :, tensor]) < 0.1 * _norm(truths[:, tensor])
    bad = np.flatnonzero(~good.all(axis=0))
    return float(found.times[inside][bad[-1]] - start)


def _norm(packed: Array) -> Array:
    """Return the Frobenius norm of tensors (..., 6)."""
    result: Array = np.linalg.norm(unpack_symmetric(packed), axis=(-2, -1))
    return result


# --- consensus --------------------------------------------------------------------------------------------------------


def _draw_consensus(found: Run) -> Figure:
    """Draw the disagreement of neighbours on the total wrench, and of robots on the body."""
    figure = Figure(figsize=(11.0, 3.7), layout="constrained")
    sums, bodies = figure.subplots(1, 2)
    late = found.times > found.start + 1.0
    for k, (part, label) in enumerate(((slice(0, 3), "force, N"), (slice(3, 6), "torque, N·m"))):
        for whose, poses in (("true poses", found.judge.relative_pose), ("their own poses", found.pose_in_use)):
            apart = _apart(found, poses)[:, :, part]
            worst = np.linalg.norm(apart, axis=2).max(axis=0)
            style = {"alpha": 0.35} if whose == "true poses" else {}
            sums.semilogy(
                found.times[::2], worst[::2], color=ROBOTS[k], linewidth=1.0, label=f"{label}, {whose}", **style
            )
            print(f"{label}: neighbours differ by {np.nanmedian(worst[late]):.2g} by {whose}, in the median")
    for k, (part, scale, label) in enumerate(
        ((slice(0, 1), 1.0, "mass, kg"), (slice(1, 4), 1e3, "centre of mass, mm"))
    ):
        values = scale * found.bodies[:, :, part]
        worst = np.linalg.norm(values - values.mean(axis=0), axis=2).max(axis=0)
        bodies.semilogy(found.times[::2], worst[::2], color=ROBOTS[2 + k], linewidth=1.0, label=label)
    sums.set_title("Total wrench: what neighbours differ by")
    sums.set_ylim(1e-4, 20.0)
    bodies.set_title("Estimates: how far from the mean")
    bodies.set_ylim(1e-6, 100.0)
    for axes in (sums, bodies):
        axes.set_xlim(0.0, found.scenario.duration)
        axes.set_xlabel("time, s")
        axes.axvline(found.start, color=SOFT, linewidth=0.9)
        axes.axvline(found.change, color=SOFT, linewidth=0.9, linestyle=(0, (2, 2)))
        axes.legend(
            frameon=True, edgecolor="none", framealpha=1.0, loc="upper left", labelcolor=INK, fontsize=9, ncols=2
        )
    return figure


def _apart(found: Run, poses: Callable[[str, str, int], Pose]) -> Array:
    """Return neighbours' transformed total wrenches minus the own ones, (edges, blocks, 6); NaN where unknown."""
    totals = {
        name: np.array(
            [b[name].total_wrench if b[name].total_block >= 0 else np.full(6, np.nan) for b in found.beliefs]
        )
        for name in found.graph
    }
    return np.array(
        [
            [poses(name, other, block).adjoint() @ total for block, total in enumerate(totals[other])] - totals[name]
            for name, others in found.graph.items()
            for other in others
        ]
    )


if __name__ == "__main__":
    main()
