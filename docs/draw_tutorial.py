"""Draws the tutorial's pictures from a run of ``ring6``. Needs coheft[study], and half a minute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from drawing import FAINT, INK, ROBOTS, SOFT, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Polygon

from coheft.app.results.judge import Judge
from coheft.app.run.inprocess import run_in_process
from coheft.consensus.graph import build_graph, laplacian
from coheft.consensus.schedule import finite_time
from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import WRENCH
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.structs import Estimate, Truth
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario

_AXES = ("#d43b3b", "#2f9e44", "#2f6fde")
_TRUTH = "#111418"
_TELLING = {"r1": np.array([0.09, -0.11]), "r4": np.array([0.14, 0.12])}
"""Two robots that say where the centre of mass is, and where the words stand."""


@dataclass(frozen=True, eq=False)
class Run:
    """What was true in a run, and what every robot believed."""

    scenario: Scenario
    scene: Scene
    truths: Sequence[Truth]
    estimates: dict[str, list[Estimate]]

    @property
    def change(self) -> float:
        """When the load changes [s]."""
        return self.scenario.load_changes[0].at

    def weighed(self, robot: str) -> list[Estimate]:
        """The robot's estimates that have everything in them."""
        return [e for e in self.estimates[robot] if e.payload is not None and e.payload.tensor is not None]


def run(scenario: Scenario) -> Run:
    """Run it in this process."""
    truths: list[Truth] = []
    estimates: dict[str, list[Estimate]] = {name: [] for name in scenario.robot_names}
    for record in run_in_process(scenario):
        truths.append(record.truth)
        for name, estimate in record.estimates.items():
            estimates[name].append(estimate)
    return Run(scenario, Simulation(scenario).scene, truths, estimates)


def main() -> None:
    """Draw all of them."""
    found = run(load_scenario("ring6"))
    _draw_frames(found)
    _draw_mass(found)
    _draw_sums(found)
    _draw_deviations(found)


def _draw_frames(found: Run) -> None:
    """The load from above, two of its grasp frames, and the centre of mass as these two robots see it."""
    figure = Figure(figsize=(8.0, 4.93))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect("equal")
    axes.axis("off")
    for box, colour in zip(found.scenario.payload.boxes, ("#e9edf1", "#d3dae2", "#d3dae2"), strict=True):
        _draw_box(axes, np.array(box.size), np.array(box.position), np.array(box.rotation_deg), colour)
    com = np.asarray(found.truths[0].payload.com)
    judge = Judge(found.scene, found.truths[:1])
    for k, (name, origin, rotation) in enumerate(
        zip(found.scene.robots, found.scene.translations, found.scene.rotations, strict=True)
    ):
        place = _TELLING.get(name)
        _draw_triad(axes, origin, rotation, 0.08 if place is None else 0.14)
        axes.add_patch(Circle(origin[:2], 0.016, color=ROBOTS[k], zorder=6))
        text = {"color": ROBOTS[k], "va": "center", "fontsize": 11}
        if place is None:
            outwards = np.sign(origin[:2]) * (np.abs(origin[:2]) > [0.49, 0.34])
            axes.text(*(origin[:2] + 0.075 * outwards), name, ha="center", weight="bold", **text)
            continue
        axes.add_patch(
            FancyArrowPatch(
                origin[:2], com[:2], arrowstyle="-|>", mutation_scale=13, shrinkB=10, color=ROBOTS[k], linewidth=1.6
            )
        )
        x, y, z = 1e3 * judge.payload(name, 0).com
        said = f"{name} says it is at\n({x:.0f}, {y:.0f}, {z:.0f}) mm"
        axes.text(*(origin[:2] + place), said, ha="left", linespacing=1.4, **text)
    _draw_com(axes, com)
    axes.text(com[0] + 0.035, com[1] - 0.06, "centre of mass", color=_TRUTH, fontsize=10.5, va="center")
    axes.text(-0.72, 0.52, "The load of ring6, from above", fontsize=12, weight="bold")
    axes.text(0.42, -0.53, "axes of a grasp frame:", color=SOFT)
    for k, (axis, colour) in enumerate(zip("xyz", _AXES, strict=True)):
        axes.text(0.83 + 0.045 * k, -0.53, axis, color=colour, weight="bold")
    axes.set_xlim(-0.95, 0.95)
    axes.set_ylim(-0.57, 0.6)
    save(figure, "tutorial-frames.svg")


def _draw_box(axes: Axes, size: Array, centre: Array, rotation_deg: Array, colour: str) -> None:
    rotation = rotation_exp(np.radians(rotation_deg))
    corners = 0.5 * size * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
    axes.add_patch(
        Polygon((corners @ rotation.T + centre)[:, :2], facecolor=colour, edgecolor="#aab4bf", linewidth=1.0)
    )


def _draw_triad(axes: Axes, origin: Array, rotation: Array, length: float) -> None:
    for column, colour in zip(np.asarray(rotation).T, _AXES, strict=True):
        ends = np.array([origin, origin + length * column])[:, :2]
        axes.plot(*ends.T, color=colour, linewidth=2.4, solid_capstyle="round", zorder=5)


def _draw_com(axes: Axes, com: Array) -> None:
    """The sign that drawings have for a centre of mass."""
    for quarter in range(4):
        angles = np.radians(90.0 * quarter + np.linspace(0.0, 90.0, 20))
        arc = com[:2] + 0.026 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        colour = _TRUTH if quarter % 2 else "white"
        axes.add_patch(Polygon([com[:2], *arc], facecolor=colour, edgecolor=_TRUTH, linewidth=1.0, zorder=8))


def _draw_mass(found: Run) -> None:
    """All robots' masses over the run, and the second around the change."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    whole, close = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    times = [truth.time for truth in found.truths]
    masses = [truth.payload.mass for truth in found.truths]
    for axes in (whole, close):
        axes.plot(times, masses, color=_TRUTH, linewidth=1.3, linestyle=(0, (5, 3)), label="true", zorder=2)
        for k, name in enumerate(found.scene.robots):
            estimates = [e for e in found.weighed(name) if axes is whole or abs(e.time - found.change) < 1.2]
            given = [e.payload.mass for e in estimates if e.payload]
            if axes is whole:  # one upon the other, the later ones thinner: all can be seen
                axes.plot([e.time for e in estimates], given, color=ROBOTS[k], label=name, linewidth=6.0 - 0.9 * k)
            else:  # beside each other
                shifted = [e.time + 0.009 * (k - 2.5) for e in estimates]
                filled = [ROBOTS[k] if e.status == "valid" else "white" for e in estimates]
                axes.scatter(shifted, given, 14, filled, edgecolors=ROBOTS[k], linewidths=0.9, zorder=3)
        axes.set_xlabel("time, s")
    whole.set_ylabel("mass, kg")
    whole.set_title("What six robots believe")
    whole.set_xlim(0.0, found.scenario.duration)
    low, high = min(masses) - 0.6, max(masses) + 0.9
    whole.set_ylim(low, high)
    start = min(found.weighed(name)[0].time for name in found.scene.robots)
    whole.axvspan(0.0, start, color="#f3f5f7", zorder=0)
    whole.text(0.5 * start, 0.5 * (low + high), "finding each other", rotation=90, ha="center", va="center", color=SOFT)
    whole.annotate(
        "3 kg are dropped",
        (found.change, 11.5),
        (found.change - 1.2, 11.5),
        ha="right",
        va="center",
        color=INK,
        arrowprops={"arrowstyle": "-|>", "color": SOFT},
    )
    legend = whole.legend(ncols=7, loc="upper left", frameon=False, fontsize=8.5, handlelength=1.1, columnspacing=0.9)
    for line in legend.get_lines():
        line.set_linewidth(2.5)
    close.set_xlim(found.change - 0.4, found.change + 1.0)
    close.set_ylim(low, high)
    close.set_title("The second in which it happens")
    noticed = max(e.load_changes[-1].noticed_at for name in found.scene.robots for e in found.estimates[name][-1:])
    close.axvline(noticed, color=SOFT, linewidth=1.0)
    close.text(noticed + 0.03, low + 0.25, f"noticed after {noticed - found.change:.1f} s", color=SOFT, va="center")
    close.text(noticed + 0.16, low + 0.9, "hollow: stale", color=SOFT, va="center")
    save(figure, "tutorial-mass.svg")


def _draw_sums(found: Run) -> None:
    """How the share that each robot carries becomes the total that every robot knows."""
    moment = next(truth for truth in found.truths if truth.time >= 15.0)
    judge = Judge(found.scene, [moment])
    forces = []
    for name, wrench in zip(found.scene.robots, moment.samples[:, WRENCH], strict=True):
        carried = judge.pose_payload_in(name, -1).inverse().adjoint() @ wrench
        forces.append(carried[2])
    values = len(forces) * np.array(forces)
    graph = build_graph(found.scenario.graph, found.scene.robots)
    rounds = [values]
    for gain in _gains(graph):
        rounds.append(rounds[-1] - gain * laplacian(graph) @ rounds[-1])
    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()
    for k, name in enumerate(found.scene.robots):
        course = [value[k] for value in rounds]
        axes.plot(course, color=ROBOTS[k], marker="o", markersize=6, linewidth=1.8, label=name)
    total = float(np.sum(forces))
    axes.axhline(total, color=_TRUTH, linewidth=1.2, linestyle=(0, (5, 3)), zorder=1)
    axes.set_xticks(range(len(rounds)), ["own share × 6", *(f"round {k}" for k in range(1, len(rounds)))])
    axes.set_xlim(-0.25, len(rounds) - 0.6)
    axes.text(len(rounds) - 1.0, total + 14.0, f"{total:.1f} N,\nthe total", ha="center", color=_TRUTH)
    axes.set_ylabel("upward force, N")
    axes.set_title("Three rounds of talking to two neighbours")
    axes.legend(ncols=6, loc="upper center", frameon=False, fontsize=9, handlelength=1.2, columnspacing=1.0)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.16 * (high - low))
    save(figure, "tutorial-sums.svg")


def _gains(graph: dict[str, tuple[str, ...]]) -> list[float]:
    """Of the rounds ``x <- x - gain L x``."""
    values = np.linalg.eigvalsh(laplacian(graph))[1:]
    distinct = np.unique(np.round(values, 9))
    assert len(distinct) == finite_time(graph).rounds
    return [1.0 / float(value) for value in distinct[::-1]]


def _draw_deviations(found: Run) -> None:
    """Errors of one robot, and what it expects them to be."""
    name = found.scene.robots[0]
    judge = Judge(found.scene, found.truths)
    estimates = found.weighed(name)
    times = np.array([e.time for e in estimates])
    errors, deviations = [], []
    for e in estimates:
        truth = judge.payload(name, e.block)
        assert e.payload is not None
        assert e.payload.com is not None
        errors.append([1e3 * (e.payload.mass - truth.mass), *(1e3 * (e.payload.com - truth.com))])
        deviations.append(1e3 * np.sqrt(np.diagonal(e.payload.covariance)[:4]))
    figure = Figure(figsize=(9.0, 3.5), layout="constrained")
    titles = (("mass", "error of the mass, g", 0), ("centre of mass, x", "error, mm", 1))
    for axes, (title, label, k) in zip(figure.subplots(1, 2), titles, strict=True):
        error, own = np.array(errors)[:, k], np.array(deviations)[:, k]
        for before in (True, False):
            part = (times < found.change) if before else (times > found.change + 0.35)
            bands = ((3.0, "#dfeaf4", "3 std"), (1.0, "#bcd5ea", "1 std"))
            for width, colour, band in bands:
                axes.fill_between(
                    times[part], -width * own[part], width * own[part], color=colour, linewidth=0,
                    label=band if before else None,
                )  # fmt: skip
            axes.plot(times[part], error[part], color=ROBOTS[0], linewidth=1.4, label="error" if before else None)
        reach = 3.4 * np.interp(6.0, times, own)
        axes.set_ylim(-reach, reach)
        axes.set_xlim(4.0, found.scenario.duration)
        axes.axhline(0.0, color=FAINT, linewidth=1.0, zorder=1)
        axes.axvline(found.change, color=SOFT, linewidth=1.0, linestyle=(0, (2, 2)))
        axes.set_title(f"{name}: {title}")
        axes.set_ylabel(label)
        axes.set_xlabel("time, s")
        axes.set_axisbelow(True)
    figure.axes[0].legend(
        loc="lower right", bbox_to_anchor=(1.02, 0.99), frameon=False, ncols=3, fontsize=9, handlelength=1.4
    )
    figure.axes[1].text(found.change + 0.5, -0.92 * figure.axes[1].get_ylim()[1], "load changes", color=SOFT)
    save(figure, "tutorial-std.svg")


if __name__ == "__main__":
    main()
