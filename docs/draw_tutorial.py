"""Draws the tutorial's pictures from a run of ``ring6``. Needs coheft[study], and half a minute."""

import numpy as np
import numpy.typing as npt
from drawing import AXES, FAINT, INK, ROBOTS, SOFT, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Polygon

import coheft
from coheft.consensus.graph import build_graph, laplacian
from coheft.consensus.schedule import finite_time
from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import WRENCH
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.schema import Scenario

_TRUTH = "#111418"
_LABELLED = {"r1": np.array([0.09, -0.11]), "r4": np.array([0.14, 0.12])}
"""Two robots whose centres of mass are written, and the places of the texts."""


def main() -> None:
    """Draw all of them."""
    simulation = coheft.simulate("ring6")
    simulation.run_until(15.0)
    assert simulation.truth is not None
    _draw_sums(simulation.scenario, simulation.truth)
    simulation.run_until(simulation.scenario.duration)
    result = simulation.result()
    _draw_frames(result)
    _draw_mass(result)
    _draw_deviations(result)


def _draw_frames(result: coheft.Result) -> None:
    """Draw the load from above, grasp frames, and the centre of mass in the frames of two robots."""
    scenario = result.scenario
    figure = Figure(figsize=(8.0, 4.93))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect("equal")
    axes.axis("off")
    for box, colour in zip(scenario.payload.boxes, ("#e9edf1", "#d3dae2", "#d3dae2"), strict=True):
        _draw_box(axes, np.array(box.size), np.array(box.position), np.array(box.rotation_deg), colour)
    com = scenario.payload.inertia().com
    for k, (name, grasp) in enumerate(zip(scenario.robot_names, scenario.robots.poses(), strict=True)):
        place, origin = _LABELLED.get(name), grasp.translation
        _draw_triad(axes, origin, grasp.rotation, 0.08 if place is None else 0.14)
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
        x, y, z = 1e3 * result.robots[name].com.truth[0]
        said = f"{name} says it is at\n({x:.0f}, {y:.0f}, {z:.0f}) mm"
        axes.text(*(origin[:2] + place), said, ha="left", linespacing=1.4, **text)
    _draw_com(axes, com)
    axes.text(com[0] + 0.035, com[1] - 0.06, "centre of mass", color=_TRUTH, fontsize=10.5, va="center")
    axes.text(-0.72, 0.52, "The load of ring6, from above", fontsize=12, weight="bold")
    axes.text(0.42, -0.53, "axes of a grasp frame:", color=SOFT)
    for k, (axis, colour) in enumerate(zip("xyz", AXES, strict=True)):
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
    for column, colour in zip(np.asarray(rotation).T, AXES, strict=True):
        ends = np.array([origin, origin + length * column])[:, :2]
        axes.plot(*ends.T, color=colour, linewidth=2.4, solid_capstyle="round", zorder=5)


def _draw_com(axes: Axes, com: Array) -> None:
    """Draw the usual symbol of a centre of mass."""
    for quarter in range(4):
        angles = np.radians(90.0 * quarter + np.linspace(0.0, 90.0, 20))
        arc = com[:2] + 0.026 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        colour = _TRUTH if quarter % 2 else "white"
        axes.add_patch(Polygon([com[:2], *arc], facecolor=colour, edgecolor=_TRUTH, linewidth=1.0, zorder=8))


def _draw_mass(result: coheft.Result) -> None:
    scenario, change = result.scenario, result.load_changes[0].at_s
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    whole, close = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    before, after = result.robots["r1"].mass.truth[[0, -1]].tolist()
    for axes in (whole, close):
        times, masses = [0.0, change, change, scenario.duration], [before, before, after, after]
        axes.plot(times, masses, color=_TRUTH, linewidth=1.3, linestyle=(0, (5, 3)), label="true", zorder=2)
        for k, (name, robot) in enumerate(result.robots.items()):
            shown = _knows_all(robot) & ((axes is whole) | (np.abs(robot.time - change) < 1.2))
            time, given = robot.time[shown], robot.mass.estimate[shown]
            if axes is whole:  # one over the other, the later ones thinner, so that all are visible
                axes.plot(time, given, color=ROBOTS[k], label=name, linewidth=6.0 - 0.9 * k)
            else:  # beside each other
                filled = np.where(robot.valid[shown], ROBOTS[k], "white")
                axes.scatter(
                    time + 0.009 * (k - 2.5), given, 14, filled, edgecolors=ROBOTS[k], linewidths=0.9, zorder=3
                )
        axes.set_xlabel("time, s")
    whole.set_ylabel("mass, kg")
    whole.set_title("What six robots believe")
    whole.set_xlim(0.0, scenario.duration)
    low, high = before - 0.6, after + 0.9
    whole.set_ylim(low, high)
    start = min(robot.time[_knows_all(robot)][0] for robot in result.robots.values())
    whole.axvspan(0.0, start, color="#f3f5f7", zorder=0)
    whole.text(start + 0.3, 0.5 * (low + high), "finding each other", rotation=90, va="center", color=SOFT)
    whole.annotate(
        "3 kg are dropped",
        (change, 11.5),
        (change - 1.2, 11.5),
        ha="right",
        va="center",
        color=INK,
        arrowprops={"arrowstyle": "-|>", "color": SOFT},
    )
    legend = whole.legend(ncols=7, loc="upper left", frameon=False, fontsize=8.5, handlelength=1.1, columnspacing=0.9)
    for line in legend.get_lines():
        line.set_linewidth(2.5)
    close.set_xlim(change - 0.4, change + 1.0)
    close.set_ylim(low, high)
    close.set_title("The second in which it happens")
    noticed = max(robot.noticed[-1] for robot in result.robots.values())
    close.axvline(noticed, color=SOFT, linewidth=1.0)
    close.text(noticed + 0.03, low + 0.25, f"noticed after {noticed - change:.1f} s", color=SOFT, va="center")
    close.text(noticed + 0.16, low + 0.9, "hollow: stale", color=SOFT, va="center")
    save(figure, "tutorial-mass.svg")


def _knows_all(robot: coheft.RobotResult) -> npt.NDArray[np.bool_]:
    """Return which of a robot's estimates are complete, shape (n,)."""
    return np.isfinite(robot.inertia.estimate[:, 0, 0])


def _draw_sums(scenario: Scenario, moment: Truth) -> None:
    """Draw how rounds turn each robot's own share into the total."""
    wrenches = zip(scenario.robots.poses(), moment.samples[:, WRENCH], strict=True)
    forces = [(grasp.adjoint() @ wrench)[2] for grasp, wrench in wrenches]
    values = len(forces) * np.array(forces)
    graph = build_graph(scenario.graph, scenario.robot_names)
    rounds = [values]
    name, others = next(iter(graph.items()))
    for gain in sorted(finite_time(graph).gains(name, others[0])):  # the same on all edges, in any order
        rounds.append(rounds[-1] - gain * laplacian(graph) @ rounds[-1])
    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()
    for k, name in enumerate(scenario.robot_names):
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


def _draw_deviations(result: coheft.Result) -> None:
    change, robot = result.load_changes[0].at_s, result.robots["r1"]
    known = _knows_all(robot)
    times = robot.time[known]
    figure = Figure(figsize=(9.0, 3.5), layout="constrained")
    drawn = (
        ("mass", "error of the mass, g", robot.mass.error, robot.mass.std),
        ("centre of mass, x", "error, mm", robot.com.error[:, 0], robot.com.std[:, 0]),
    )
    for axes, (title, label, errors, deviations) in zip(figure.subplots(1, 2), drawn, strict=True):
        error, own = 1e3 * errors[known], 1e3 * deviations[known]
        for before in (True, False):
            part = (times < change) if before else (times > change + 0.35)
            bands = ((3.0, "#dfeaf4", "3 std"), (1.0, "#bcd5ea", "1 std"))
            for width, colour, band in bands:
                axes.fill_between(
                    times[part], -width * own[part], width * own[part], color=colour, linewidth=0,
                    label=band if before else None,
                )  # fmt: skip
            axes.plot(times[part], error[part], color=ROBOTS[0], linewidth=1.4, label="error" if before else None)
        reach = 3.4 * np.interp(6.0, times, own)
        axes.set_ylim(-reach, reach)
        axes.set_xlim(4.0, result.scenario.duration)
        axes.axhline(0.0, color=FAINT, linewidth=1.0, zorder=1)
        axes.axvline(change, color=SOFT, linewidth=1.0, linestyle=(0, (2, 2)))
        axes.set_title(f"r1: {title}")
        axes.set_ylabel(label)
        axes.set_xlabel("time, s")
        axes.set_axisbelow(True)
    figure.axes[0].legend(
        loc="lower right", bbox_to_anchor=(1.02, 0.99), frameon=False, ncols=3, fontsize=9, handlelength=1.4
    )
    figure.axes[1].text(change + 0.5, -0.92 * figure.axes[1].get_ylim()[1], "load changes", color=SOFT)
    save(figure, "tutorial-std.svg")


if __name__ == "__main__":
    main()
