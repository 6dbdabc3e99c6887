"""Results of benchmarks: figures in sections, as Markdown and JSON."""

import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from coheft.errors import CoheftError

T = TypeVar("T")
Effort = Literal["short", "usual", "full"]
"""Amount of measurements: for the regression guard, for some minutes, or all."""


class Figure(msgspec.Struct, frozen=True, kw_only=True):
    """One figure.

    Attributes:
        name: Name, unique within the section.
        unit: Unit; "times" for a ratio.
        bar: Target; None if there is none.
        more_is_better: Whether larger figures are better.
        is_guarded: Whether the regression guard compares it: a ratio of two costs that were measured side by side.
    """

    name: str
    value: float
    unit: str = "times"
    bar: float | None = None
    more_is_better: bool = False
    is_guarded: bool = False
    note: str = ""

    @property
    def misses_bar(self) -> bool:
        """Whether it misses its target."""
        if self.bar is None:
            return False
        return self.value < self.bar if self.more_is_better else self.value > self.bar


class Section(msgspec.Struct, frozen=True, kw_only=True):
    """All figures of one benchmark.

    Attributes:
        name: Name of its module.
        skipped: Reasons why measurements were not made, by name.
        seconds: Duration of the measurement [s].
        has_failed: Whether an error ended it; it then has no figures.
    """

    name: str
    title: str
    figures: list[Figure]
    skipped: dict[str, str] = {}
    seconds: float = 0.0
    has_failed: bool = False


class Machine(msgspec.Struct, frozen=True, kw_only=True):
    """The machine, and its load."""

    cores: int
    python: str
    numpy: str
    load_before: float
    load_after: float


class Results(msgspec.Struct, frozen=True, kw_only=True):
    """All benchmarks of one run."""

    effort: Effort
    machine: Machine
    sections: list[Section]

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write ``bench.md`` and ``bench.json``; return their paths."""
        folder.mkdir(parents=True, exist_ok=True)
        table, data = folder / "bench.md", folder / "bench.json"
        table.write_text(self.markdown(), encoding="utf-8")
        data.write_bytes(msgspec.json.format(msgspec.json.encode(self)) + b"\n")
        return table, data

    def markdown(self) -> str:
        """Return a table for each section."""
        machine = self.machine
        lines = [
            "# Benchmarks",
            "",
            f"{machine.cores} cores, Python {machine.python}, numpy {machine.numpy}; load average "
            f"{machine.load_before:.1f} before, {machine.load_after:.1f} after. "
            "Figures in bold miss what they should reach.",
        ]
        for section in self.sections:
            lines += ["", f"## {section.title}", "", *section_lines(section)]
        return "\n".join(lines) + "\n"


def load_results(path: Path) -> Results:
    """Read the JSON of ``Results.write``; raise ``CoheftError`` if it cannot be read."""
    return read_json(path, Results, "a bench.json of 'python -m benchmarks'", "python -m benchmarks")


def read_json(path: Path, kind: type[T], what: str, command: str) -> T:
    """Read a JSON file that a command writes; raise ``CoheftError`` if it cannot be read."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except OSError as error:
        raise CoheftError(f"{path}: cannot be read: {error.strerror}; '{command}' makes it") from error
    except msgspec.DecodeError as error:
        raise CoheftError(f"{path}: not {what}: {error}") from error


def section_lines(section: Section) -> list[str]:
    """Return the lines of a section's table, and of skipped measurements."""
    lines = []
    if section.figures:
        lines += ["| what | figure | should be | |", "|---|---:|---:|---|"]
        lines += [_row(figure) for figure in section.figures]
    lines += [f"- not measured: {name}: {reason}" for name, reason in section.skipped.items()]
    return [*lines, "", f"Took {section.seconds:.0f} s."]


def _row(figure: Figure) -> str:
    value = f"{digits(figure.value)} {figure.unit}"
    if figure.misses_bar:
        value = f"**{value}**"
    bar = ""
    if figure.bar is not None:
        bar = f"{'≥' if figure.more_is_better else '≤'} {digits(figure.bar)}"
    return f"| {figure.name} | {value} | {bar} | {figure.note} |"


def ratio(times: Sequence[float], others: Sequence[float]) -> float:
    """Return the median over rounds of the ratio of two times measured side by side: other load affects both."""
    return statistics.median(mine / its for mine, its in zip(times, others, strict=True))


def against(
    name: str,
    times: Sequence[float],
    others: Sequence[float],
    *,
    bar: float | None = None,
    is_guarded: bool = False,
    of: str = "",
) -> Figure:
    """Return the ``ratio`` of times [s] that were measured side by side; ``of`` says whose they are."""
    note = f"{1e3 * statistics.median(times):.2f} against {1e3 * statistics.median(others):.2f} ms{of}"
    return Figure(name=name, value=ratio(times, others), bar=bar, is_guarded=is_guarded, note=note)


def digits(value: float) -> str:
    """Format with three significant digits, with an exponent only for very small and large numbers."""
    if value != 0.0 and not 1e-3 <= abs(value) < 1e6:
        return f"{value:.1e}"
    if abs(value) >= 100.0 or value == int(value):
        return f"{value:,.0f}"
    return f"{value:.3g}"


def guarded(sections: Iterable[Section]) -> dict[str, float]:
    """Return the ratios that the regression guard compares, by section and name."""
    return {
        f"{section.name}: {figure.name}": figure.value
        for section in sections
        for figure in section.figures
        if figure.is_guarded
    }
