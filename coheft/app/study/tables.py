"""A study's report in tables and sentences."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from coheft.app.results.errors import MOST_STDS, VALID_STDS
from coheft.app.results.quantities import ALL_TEN, QUANTITIES
from coheft.app.study.detection import Detection
from coheft.app.study.report import Accuracy, Cell, Consistency, EstimatorResult, Number, Recovered, StudyReport

NAMES = {
    "pose_rotation": ("rotation", "°", math.degrees(1.0)),
    "pose_translation": ("translation", "mm", 1e3),
    "mass": ("mass", "kg", 1.0),
    "com": ("centre of mass", "mm", 1e3),
    "inertia": ("inertia", "kg·m²", 1.0),
}
"""Names and units of quantities, with the factor from SI units."""
_HEADER = ("quantity", "estimator", "RMS", "bound", "RMS / bound", "NEES", "/ two-step", "honest NEES", "missing")
_RECOVERY_HEADER = ("quantity", "estimator", "RMS", "bound", "RMS / bound", "NEES", "missing")
LEGEND = (
    "NEES: error² over stated covariance, 1 if honest; * outside its 95 % range.",
    "/ two-step: RMS over the bound of poses from motion alone. (…): 95 % range.",
)
"""Explanation of the columns for the terminal."""
_EXPLANATION = (
    "rotation, translation: of the neighbours' grasp frames in the own one. RMS: root mean square error.",
    "bound: Cramér-Rao bound of any unbiased estimator that uses every sample of every robot's sensors, but not that "
    "motions are smooth; after a load change, of one that knows its time. In brackets: 95 % sampling interval over "
    "runs.",
    "NEES: squared error over the covariance that the robot stated, per degree of freedom; of one robot per run, "
    "because those of one run see the same data. With an honest covariance it lies within the range of 'honest NEES' "
    "95 times of 100; * marks those that do not.",
    "/ two-step: RMS error over the bound of estimators that find poses from kinematics alone, and then inertia from "
    "all sensors given those poses.",
    "missing: estimates for which no number was claimed; they are left out of the other columns.",
)


class Part(NamedTuple):
    """A table of a report; the first seven columns are the most important ones."""

    title: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]


def parts(report: StudyReport) -> Iterator[Part | list[str]]:
    """Yield the tables of a report, and sentences between and below them."""
    for cell in report.cells:
        yield Part(caption(cell), _HEADER, list(_accuracy_rows(cell)))
    if len(report.cells) > 1:
        yield list(_together(report))
    recoveries = [result.recovery for result in report.results.values() if result.recovery is not None]
    if recoveries:
        title = f"{recoveries[0].seconds_after:g} s after the load change"
        yield Part(title, _RECOVERY_HEADER, list(_recovery_rows(report.results)))
    yield [line for name, result in report.results.items() for line in sentences(name, result)]


def _accuracy_rows(cell: Cell) -> Iterator[tuple[str, ...]]:
    """Yield one row per quantity and estimator, columns as in ``_HEADER``."""
    for quantity in QUANTITIES:
        name, unit, size = NAMES[quantity.name]
        for estimator, result in cell.results.items():
            found: Accuracy = getattr(result, quantity.name)
            ranges = short(found.ratio_two_step), _range(found.nees_low, found.nees_high)
            yield f"{name}, {unit}", estimator, *_compared(found, size), *ranges, str(found.missing)
    for estimator, result in cell.results.items():
        yield "robots converged", estimator, f"{100.0 * result.converged:.0f} %", *[""] * 6
    for estimator, result in cell.results.items():
        joint = result.all_ten
        yield "all ten together", estimator, "", "", "", _marked(joint), "", _range(joint.nees_low, joint.nees_high), ""


def _recovery_rows(results: Mapping[str, EstimatorResult]) -> Iterator[tuple[str, ...]]:
    for key in ("mass", "com", "inertia"):
        name, unit, size = NAMES[key]
        for estimator, result in results.items():
            if result.recovery is not None:
                found: Recovered = getattr(result.recovery, key)
                yield f"{name}, {unit}", estimator, *_compared(found, size), str(found.missing)


def _compared(found: Recovered, size: float) -> tuple[str, ...]:
    """Return the cells from ``RMS`` to ``NEES``; ``size`` is the factor from SI units."""
    ratio = f"{short(found.ratio_full)} ({_range(found.ratio_full_low, found.ratio_full_high)})"
    rms, bound = plain(found.rms, size), plain(found.bound_full, size)
    return rms, bound, "–" if found.ratio_full is None else ratio, _marked(found)


def sentences(estimator: str, result: EstimatorResult) -> Iterator[str]:
    """Yield sentences about results that are not in the tables."""
    detection = result.detection
    if result.recovery is not None:
        yield f"{estimator}: {_noticed(detection)}"
    count = detection.false_alarms
    alarms = f"{count or 'no'} false alarm{'' if count < 2 else 's'}"
    yield f"{estimator}: {alarms} in {detection.hours:.3g} simulated hours."
    claimed = result.claimed
    if claimed.contradicted:
        yield (
            f"{estimator}: {claimed.contradicted} of {claimed.count} estimates are further off than they claim, by up "
            f"to {claimed.most_stds:.3g} own std (up to {MOST_STDS:g} is normal)."
        )
    elif claimed.count:
        yield f"{estimator}: no estimate is off by more than {MOST_STDS:g} own std."
    if claimed.valid_numbers:
        yield (
            f"{estimator}: {claimed.beyond_five} of {claimed.valid_numbers:,} numbers of valid estimates are off by "
            f"more than {VALID_STDS:g} own std."
        )
    missing = sum(getattr(result, quantity.name).missing for quantity in QUANTITIES)
    if missing:
        yield f"{estimator}: no number was claimed for {missing} estimates; they are left out."
    if result.impossible_payloads:
        yield f"{estimator}: {result.impossible_payloads} published payloads that cannot exist."
    else:
        yield f"{estimator}: every published payload can exist."


def title(report: StudyReport) -> str:
    """Return a line that describes the study."""
    runs = f"{report.runs} run{'s' * (report.runs != 1)}"
    times = ", ".join(f"{at:g}" for at in report.at_s)
    return (
        f"{report.scenario}: {runs} (seeds {report.seeds[0]} to {report.seeds[1]}) per noise scale, judged at {times} s"
    )


def caption(cell: Cell) -> str:
    """Return the caption of one noise and time."""
    return f"noise × {cell.noise_scale:g}, at {cell.at_s:g} s"


def _together(report: StudyReport) -> Iterator[str]:
    """Yield a line for each estimator about all noises and times."""
    for estimator, result in report.results.items():
        ratios = [getattr(result, quantity.name).ratio_full for quantity in QUANTITIES]
        nees = [getattr(result, quantity.name).nees for quantity in (*QUANTITIES, ALL_TEN)]
        cells = result.cells
        yield (
            f"{estimator}, all together: RMS / bound {', '.join(map(short, ratios))}; NEES "
            f"{', '.join(map(short, nees))} (all ten last); outside 95 % range: {cells.outside_95} of {cells.count}, "
            f"outside 99.99 %: {cells.outside_9999}."
        )


def markdown(report: StudyReport, pictures: dict[str, str]) -> str:
    """Return the report as Markdown; ``pictures`` are file names by caption."""
    blocks = [f"# Study of {title(report)}"]
    for part in parts(report):
        if isinstance(part, Part):
            blocks += [f"## {part.title.capitalize()}", markdown_table(part.header, part.rows)]
        else:
            blocks.append("\n".join(f"- {line}" for line in part))
    blocks.append("## How to read this\n\n" + "\n".join(f"- {line}" for line in _EXPLANATION))
    blocks.extend(f"![{caption}]({file})" for caption, file in pictures.items())
    return "\n\n".join(blocks) + "\n"


def _noticed(detection: Detection) -> str:
    missed = f"runs in which some robot did not notice the change: {detection.missed}" if detection.missed else ""
    if detection.delay_s is None or detection.delay_max_s is None:
        return f"{missed}."
    noticed = (
        f"the last robot noticed the change {detection.delay_s:.2f} s after it on average, "
        f"{detection.delay_max_s:.2f} s at most"
    )
    return f"{noticed}; {missed}." if missed else f"{noticed}."


def markdown_table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """Return a table of these cells in Markdown."""
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def plain(value: Number, factor: float = 1.0) -> str:
    """Format a number with three digits, in another unit."""
    return "–" if value is None else f"{value * factor:#.3g}".rstrip(".")


def short(value: Number) -> str:
    """Format a ratio, with two decimals if it is small."""
    return "–" if value is None else f"{value:.2f}" if value < 10.0 else f"{value:.0f}"


def _range(low: Number, high: Number) -> str:
    return "" if low is None or high is None else f"{short(low)}–{short(high)}"


def _marked(found: Consistency) -> str:
    """Format a NEES, with a star if it is outside its interval."""
    if found.nees is None or found.nees_low is None or found.nees_high is None:
        return "–"
    return f"{short(found.nees)}{'' if found.nees_low <= found.nees <= found.nees_high else '*'}"
