"""Draws the picture of consensus.md: convergence of consensus as measured, against theory.

Some seconds. Needs coheft[study].
"""

from collections.abc import Callable

import numpy as np
from drawing import ROBOTS, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coheft.consensus import (
    DynamicConsensus,
    Neighbours,
    NeighbourStages,
    choose_schedule,
    convergence_rate,
    finite_time,
    lag_bound,
    laplacian,
    metropolis_matrix,
    metropolis_weight,
)
from coheft.consensus.graph import build_graph
from coheft.estimation.geometry.spatial import Array
from coheft.wire.scenario.schema import Graph

_AGENTS = 12
_NAMES = [f"r{k:02d}" for k in range(_AGENTS)]
_GRAPHS = {kind: build_graph(Graph(kind=kind, seed=2), _NAMES) for kind in ("ring", "line", "grid", "random")}
_BLOCKS_PER_SWING = 100
"""Period of oscillating inputs, each with its own phase."""
_BLOCKS = 600
"""Length of a run with them: of what it starts with, less than rounding is left for the last two periods."""
_SMALLEST = 1e-17


def main() -> None:
    """Draw it."""
    figure = Figure(figsize=(11.0, 3.7), layout="constrained")
    settling, lagging, exact = figure.subplots(1, 3)
    for colour, (kind, graph) in zip(ROBOTS, _GRAPHS.items(), strict=False):
        _draw_settling(settling, kind, graph, colour)
        _draw_lag(lagging, kind, graph, colour)
        _draw_finite_time(exact, kind, graph, colour)
    settling.set(title="Inputs that stay: disagreement", xlabel="round", ylim=(1e-12, 2.0))
    lagging.set(title="Inputs that swing: lag, over inputs' size", xlabel="rounds per block")
    exact.set(title="Finite time: disagreement", xlabel="round", ylim=(_SMALLEST, 1e2))
    for axes in (settling, exact):
        axes.legend(frameon=False, fontsize=9)
    save(figure, "consensus.svg")


def _run(graph: Neighbours, rounds: int, inputs: Callable[[int], Array], blocks: int) -> Array:
    """Return the outputs of dynamic consensus on numbers (N,), in one frame, shape (blocks - rounds, N)."""
    agents = {name: DynamicConsensus(rounds, 1, 1) for name in graph}
    found = []
    for block in range(blocks):
        sent = {name: agent.pipeline.sent() for name, agent in agents.items()}
        row = []
        for value, (name, agent) in zip(inputs(block), agents.items(), strict=True):
            received = [
                NeighbourStages(None, np.full(rounds, metropolis_weight(len(graph[name]), len(graph[j]))), *sent[j])
                for j in graph[name]
            ]
            row.append(agent.step(np.array([[value]]), received))
        if all(each is not None for each in row):
            found.append([float(each[0, 0]) for each in row if each is not None])
    return np.array(found)


def _draw_settling(axes: Axes, kind: str, graph: Neighbours, colour: str) -> None:
    """Draw the disagreement after each round, with one round per block."""
    inputs = np.random.default_rng(1).normal(size=_AGENTS)
    found = _run(graph, 1, lambda block: inputs, 301)
    apart = np.linalg.norm(found - inputs.mean(), axis=1)
    rate = convergence_rate(metropolis_matrix(graph))
    count = np.arange(1, len(apart) + 1)
    axes.semilogy(count[::12], apart[::12], "o", color=colour, markersize=3.5, label=f"{kind}: r = {rate:.3f}")
    late = int(np.searchsorted(-apart, -1e-6))  # only the slowest mode is left
    late = min(late, len(apart) - 1)
    axes.semilogy(count, apart[late] * rate ** (count - count[late]), color=colour, linewidth=1.0)
    measured = (apart[late] / apart[late // 2]) ** (1.0 / (late - late // 2))
    print(f"{kind}: a round leaves {measured:.4f} of the disagreement, by theory {rate:.4f}")


def _draw_lag(axes: Axes, kind: str, graph: Neighbours, colour: str) -> None:
    phases = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, _AGENTS)

    def inputs(block: int) -> Array:
        return np.sin(2.0 * np.pi * block / _BLOCKS_PER_SWING + phases)

    rate = convergence_rate(metropolis_matrix(graph))
    tried = (4, 8, 16, 32)
    lags, bounds = [], []
    for rounds in tried:
        found = _run(graph, rounds, inputs, _BLOCKS)[-2 * _BLOCKS_PER_SWING :]
        blocks = range(_BLOCKS - rounds - len(found), _BLOCKS - rounds)
        truth = np.array([inputs(block).mean() for block in blocks])
        lags.append(np.linalg.norm(found - truth[:, None], axis=1).max() / _AGENTS**0.5)
        moved = np.array([inputs(block + rounds) - inputs(block) for block in range(_BLOCKS_PER_SWING)])
        moved -= moved.mean(axis=1, keepdims=True)
        bounds.append(lag_bound(rate, rounds, float(np.linalg.norm(moved, axis=1).max())) / _AGENTS**0.5)
    axes.loglog(tried, lags, "o", color=colour, markersize=4.5)
    axes.loglog(tried, bounds, color=colour, linewidth=1.0)
    axes.set_xticks(tried, [str(rounds) for rounds in tried])
    axes.minorticks_off()
    print(f"{kind}: lags of {np.round(lags, 5)} at {tried} rounds, bounds {np.round(bounds, 5)}")


def _draw_finite_time(axes: Axes, kind: str, graph: Neighbours, colour: str) -> None:
    schedule = finite_time(graph)
    values = np.random.default_rng(3).normal(size=_AGENTS)
    mean, matrix = values.mean(), laplacian(graph)
    apart = [float(np.linalg.norm(values - mean))]
    name, others = next(iter(graph.items()))
    for gain in schedule.gains(name, others[0]):  # the same on all edges
        values = values - gain * matrix @ values
        apart.append(max(float(np.linalg.norm(values - mean)), _SMALLEST))
    chosen = choose_schedule(graph)
    axes.semilogy(apart, "o-", color=colour, markersize=3.5, linewidth=1.0, label=f"{kind}: {schedule.rounds} rounds")
    print(f"{kind}: {schedule.rounds} rounds leave {apart[-1]:.1e}; chosen is {chosen.kind}, {chosen.rounds} rounds")


if __name__ == "__main__":
    main()
