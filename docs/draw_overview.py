"""Draws pictures/overview.svg: the team with its load, and the links between processes. Needs coheft[study]."""

import numpy as np
from drawing import AXES, FAINT, INK, ROBOTS, SOFT, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyArrowPatch, FancyBboxPatch, Polygon

from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario

_AZIMUTH, _ELEVATION = np.radians(-76.0), np.radians(40.0)
_RIGHT = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
_TOWARDS = np.array([np.cos(_ELEVATION) * np.cos(_AZIMUTH), np.cos(_ELEVATION) * np.sin(_AZIMUTH), np.sin(_ELEVATION)])
_UP = np.cross(_TOWARDS, _RIGHT)
_FLOOR = -0.30
_LINK = "#f2a33a"


def main() -> None:
    """Draw it."""
    scenario = load_scenario("ring6")
    figure = Figure(figsize=(11.0, 4.9))
    left = figure.add_axes((0.0, 0.0, 0.57, 1.0))
    right = figure.add_axes((0.575, 0.0, 0.425, 1.0))
    for axes in (left, right):
        axes.set_aspect("equal")
        axes.axis("off")
    _draw_team(left, scenario)
    _draw_processes(right)
    save(figure, "overview.svg")


def _flat(points: Array) -> Array:
    """Project points (..., 3) to the picture (..., 2)."""
    return np.stack([points @ _RIGHT, points @ _UP], axis=-1)


def _draw_team(axes: Axes, scenario: Scenario) -> None:
    scene = Simulation(scenario).scene
    grasps = np.asarray(scene.translations)
    outwards = grasps * [1.0, 1.0, 0.0]
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    feet = grasps + 0.46 * outwards
    feet[:, 2] = _FLOOR
    behind = [k for k in range(len(grasps)) if grasps[k] @ _TOWARDS < 0.0]
    front = [k for k in np.argsort(feet @ _TOWARDS) if k not in behind]
    shadow = np.array([[x, y, _FLOOR] for x, y in ((-0.5, -0.35), (0.5, -0.35), (0.5, 0.35), (-0.5, 0.35))])
    axes.add_patch(Polygon(_flat(shadow), facecolor="#eef1f4", edgecolor="none"))
    for k in sorted(behind, key=lambda k: feet[k] @ _TOWARDS):
        _draw_robot(axes, feet[k], grasps[k], ROBOTS[k], scene.robots[k])
    for box in scenario.payload.boxes:
        _draw_box(axes, np.array(box.size), np.array(box.position), np.array(box.rotation_deg), "#b9c4d0")
    change = scenario.load_changes[0]
    landing = np.array(change.position) - [0.0, 0.0, 0.05]
    lifted = np.array(change.position) + [0.0, 0.0, 0.30]
    axes.add_patch(
        FancyArrowPatch(
            *(_flat(lifted - [0.0, 0.0, 0.06]), _flat(landing)),
            arrowstyle="-|>",
            mutation_scale=12,
            color="#c0314f",
            linestyle=(0, (3, 2)),
        )
    )
    _draw_box(axes, np.full(3, 0.12), lifted, np.zeros(3), "#f0b49a")
    axes.text(*(_flat(lifted) + [0.13, 0.06]), "3 kg are dropped\nonto it", va="center", color=INK, fontsize=10)
    for k in front:
        _draw_robot(axes, feet[k], grasps[k], ROBOTS[k], scene.robots[k])
    for k in range(len(grasps)):
        _draw_frame(axes, grasps[k], np.asarray(scene.rotations[k]))
    heads = _flat(feet + [0.0, 0.0, 0.13])
    for k in range(len(heads)):
        _draw_link(axes, heads[k], heads[(k + 1) % len(heads)])
    axes.set_xlim(-1.12, 1.12)
    axes.set_ylim(-1.03, 0.97)
    axes.text(-1.08, 0.87, "Six robots hold one load.", fontsize=13, weight="bold")
    axes.text(
        -1.08,
        0.66,
        "None knows its mass, or where\nthe others hold it. Each talks\nwith its neighbours only.",
        fontsize=10,
        color=SOFT,
        va="center",
        linespacing=1.35,
    )


def _draw_box(axes: Axes, size: Array, centre: Array, rotation_deg: Array, colour: str) -> None:
    """Draw the three visible faces of a box, lit from above."""
    rotation = rotation_exp(np.radians(rotation_deg))
    base = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    for axis in range(3):
        normal = rotation[:, axis] * np.sign(rotation[:, axis] @ _TOWARDS)
        u, v = (rotation[:, k] * size[k] / 2.0 for k in range(3) if k != axis)
        middle = centre + normal * size[axis] / 2.0
        face = np.array([middle + u + v, middle + u - v, middle - u - v, middle - u + v])
        light = 0.80 + 0.26 * normal[2] - 0.07 * (normal @ _RIGHT)
        axes.add_patch(
            Polygon(_flat(face), facecolor=np.clip(base * light, 0.0, 1.0), edgecolor="#7b8794", linewidth=0.7)
        )


def _draw_robot(axes: Axes, foot: Array, grasp: Array, colour: str, name: str) -> None:
    """Draw a round mobile base, a column, and an arm with an elbow."""
    squash = np.sin(_ELEVATION)
    low, high = _flat(foot), _flat(foot + [0.0, 0.0, 0.13])
    axes.add_patch(Ellipse(low, 0.24, 0.24 * squash, facecolor=colour, edgecolor="none", alpha=0.85))
    axes.add_patch(
        Polygon([low - [0.12, 0], low + [0.12, 0], high + [0.12, 0], high - [0.12, 0]], facecolor=colour, alpha=0.85)
    )
    axes.add_patch(Ellipse(high, 0.24, 0.24 * squash, facecolor=colour, edgecolor="white", linewidth=1.2))
    elbow = foot + 0.40 * (grasp - foot)
    elbow[2] = grasp[2] + 0.08
    joints = _flat(np.array([foot + [0.0, 0.0, 0.13], elbow, grasp]))
    round_ends = {"solid_capstyle": "round", "solid_joinstyle": "round", "zorder": 1}
    axes.plot(*joints.T, color=colour, linewidth=6.0, **round_ends)
    axes.plot(*joints.T, color="white", linewidth=1.4, alpha=0.55, **round_ends)
    label = 0.5 * (low + high) - [0.0, 0.5 * 0.24 * squash]
    axes.text(*label, name, color="white", ha="center", va="center", fontsize=9, weight="bold", zorder=1)


def _draw_frame(axes: Axes, origin: Array, rotation: Array) -> None:
    for column, colour in zip(rotation.T, AXES, strict=True):
        ends = _flat(np.array([origin, origin + 0.13 * column]))
        axes.plot(*ends.T, color="white", linewidth=3.4, solid_capstyle="round", zorder=5)
        axes.plot(*ends.T, color=colour, linewidth=2.0, solid_capstyle="round", zorder=6)
    axes.add_patch(Circle(_flat(origin), 0.014, color=INK, zorder=7))


def _draw_link(axes: Axes, start: Array, end: Array) -> None:
    """Draw a link between neighbours as an arc that bends away from the load."""
    axes.add_patch(
        FancyArrowPatch(
            start,
            end,
            connectionstyle="arc3,rad=0.22",
            arrowstyle="<|-|>",
            mutation_scale=9,
            color=_LINK,
            linewidth=1.8,
            shrinkA=15,
            shrinkB=15,
            zorder=4,
        )
    )


def _draw_processes(axes: Axes) -> None:
    axes.set_xlim(-1.25, 1.25)
    axes.set_ylim(-1.45, 1.43)
    axes.text(-1.2, 1.27, "One process each, linked by Zenoh.", fontsize=13, weight="bold")
    places = [0.78 * np.array([np.cos(angle), np.sin(angle)]) for angle in np.radians(210.0 + 60.0 * np.arange(6))]
    places = [place + [0.0, 0.16] for place in places]
    middle = np.array([0.0, 0.16])
    for k, place in enumerate(places):
        axes.plot(*np.array([middle, place]).T, color="#9aa5b1", linewidth=1.3, zorder=0)
        axes.plot(*np.array([place, places[(k + 1) % 6]]).T, color=_LINK, linewidth=3.0, zorder=0)
    style = "round,pad=0,rounding_size=0.06"
    axes.add_patch(
        FancyBboxPatch(
            middle - [0.31, 0.17], 0.62, 0.34, boxstyle=style, facecolor="white", edgecolor=SOFT, linewidth=1.3
        )
    )
    axes.text(*middle, "physics server\nMuJoCo", ha="center", va="center", fontsize=9.5)
    for k, place in enumerate(places):
        axes.add_patch(Circle(place, 0.165, facecolor=ROBOTS[k], edgecolor="white", linewidth=2.5))
        axes.text(*place, f"r{k + 1}", color="white", ha="center", va="center", weight="bold", fontsize=11)
    _legend(axes)


def _legend(axes: Axes) -> None:
    lines = (
        (_LINK, 3.0, "-", "with its neighbours: sums, and where they hold the load"),
        ("#9aa5b1", 1.3, "-", "with the server: its own sensors, its own arm"),
        (FAINT, 0.0, "-", "never: the truth, or who else is there"),
    )
    for k, (colour, width, style, text) in enumerate(lines):
        height = -0.98 - 0.17 * k
        if width:
            axes.plot([-1.16, -0.98], [height, height], color=colour, linewidth=width, linestyle=style)
        else:
            axes.text(-1.07, height, "×", color="#c0314f", ha="center", va="center", fontsize=13)
        axes.text(-0.9, height, text, va="center", fontsize=9, color=SOFT)


if __name__ == "__main__":
    main()
