"""A study's report in tables and sentences, for people."""

from __future__ import annotations

from collections.abc import Iterator

from coheft.app.study.detection import Detection
from coheft.app.study.quantities import QUANTITIES
from coheft.app.study.report import Accuracy, EstimatorResult, NoiseResult, Number, Recovered, StudyReport

NAMES = {
    "pose_rotation": ("neighbours' rotation", "°", 57.29577951308232),
    "pose_translation": ("neighbours' place", "mm", 1e3),
    "mass": ("mass", "kg", 1.0),
    "com": ("centre of mass", "mm", 1e3),
    "inertia": ("inertia", "kg·m²", 1.0),
}
"""Of quantities: name, unit, and that unit's size in SI units."""
HEADER = ("quantity", "estimator", "RMS error", "bound", "error / bound", "NEES", "honest NEES", "/ central", "missing")
RECOVERY_HEADER = ("quantity", "estimator", "RMS error", "bound", "error / bound", "missing")
EXPLANATION = """\
- *bound*: Cramér-Rao bound of any unbiased estimator that finds poses from kinematics and then inertia from all
  sensors, given every sample of every robot. In brackets: 95 % sampling interval over runs.
- *NEES*: squared error over the covariance that the robot stated itself, per degree of freedom; of one robot per run,
  because robots of one run see the same data. With an honest covariance it lies in the range beside it 95 times of 100.
- */ central*: RMS error over that of a batch solution with all samples in one place.
- *missing*: estimates for which no number was claimed; they are left out of the other columns.
"""


def accuracy_rows(noise: NoiseResult) -> Iterator[tuple[str, ...]]:
    """One row per quantity and estimator, columns as in ``HEADER``."""
    for quantity in QUANTITIES:
        name, unit, size = NAMES[quantity.name]
        for estimator, result in noise.results.items():
            found: Accuracy = getattr(result, quantity.name)
            yield (
                f"{name}, {unit}",
                estimator,
                _plain(found.rms, size),
                _plain(found.bound, size),
                _with_range(found.ratio, found.ratio_low, found.ratio_high),
                _plain(found.nees),
                _range(found.nees_low, found.nees_high),
                _plain(result.decentralised_over_centralised[quantity.name]),
                str(found.missing),
            )
    for estimator, result in noise.results.items():
        all_ten = result.all_ten
        yield (
            *("all ten of the payload", estimator, "", "", ""),
            *(_plain(all_ten.nees), _range(all_ten.nees_low, all_ten.nees_high), "", ""),
        )


def recovery_rows(noise: NoiseResult) -> Iterator[tuple[str, ...]]:
    """One row per quantity and estimator, columns as in ``RECOVERY_HEADER``; none if the load did not change."""
    for key in ("mass", "com", "inertia"):
        name, unit, size = NAMES[key]
        for estimator, result in noise.results.items():
            if result.recovery is not None:
                found: Recovered = getattr(result.recovery, key)
                ratio = _with_range(found.ratio, found.ratio_low, found.ratio_high)
                yield (
                    *(f"{name}, {unit}", estimator, _plain(found.rms, size), _plain(found.bound, size)),
                    *(ratio, str(found.missing)),
                )


def sentences(estimator: str, result: EstimatorResult) -> Iterator[str]:
    """What is not in the tables."""
    detection = result.detection
    if result.recovery is not None:
        yield f"{estimator}: {_noticed(detection)}"
    alarms = "no false alarm" if detection.false_alarms == 0 else f"{detection.false_alarms} false alarms"
    yield f"{estimator}: {alarms} in {detection.hours:.3g} simulated hours."
    if result.consistency_violations:
        yield f"{estimator}: {result.consistency_violations} published payloads that cannot exist."
    else:
        yield f"{estimator}: every published payload can exist."


def title(report: StudyReport) -> str:
    """What was studied, in a line."""
    return (
        f"{report.scenario}: {report.robots} robots, {report.runs} runs (seeds {report.seeds[0]} to "
        f"{report.seeds[1]}) per noise scale, judged at {report.at_s:g} s"
    )


def markdown(report: StudyReport, pictures: dict[str, str]) -> str:
    """The report as Markdown; ``pictures`` are file names by caption."""
    parts = [f"# Study of {title(report)}"]
    for noise in report.all_scales():
        parts.append(f"## Noise × {noise.noise_scale:g}")
        parts.append(_markdown_table(HEADER, list(accuracy_rows(noise))))
        recovery = list(recovery_rows(noise))
        if recovery:
            after = next(r.recovery.seconds_after for r in noise.results.values() if r.recovery is not None)
            parts.append(
                f"{after:g} s after the load had changed, against the bound of an estimator that is told the moment:"
            )
            parts.append(_markdown_table(RECOVERY_HEADER, recovery))
        parts.append(
            "\n".join(f"- {line}" for name, result in noise.results.items() for line in sentences(name, result))
        )
    parts.append("## How to read this\n\n" + EXPLANATION.rstrip())
    parts.extend(f"![{caption}]({file})" for caption, file in pictures.items())
    return "\n\n".join(parts) + "\n"


def _noticed(detection: Detection) -> str:
    missed = f"in {detection.missed} runs some robot did not notice the change" if detection.missed else ""
    if detection.delay_s is None or detection.delay_max_s is None:
        return f"{missed}."
    noticed = (
        f"the last robot noticed the change {detection.delay_s:.2f} s after it on average, "
        f"{detection.delay_max_s:.2f} s at most"
    )
    return f"{noticed}; {missed}." if missed else f"{noticed}."


def _markdown_table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _plain(value: Number, size: float = 1.0) -> str:
    return "–" if value is None else f"{value * size:#.3g}"


def _range(low: Number, high: Number) -> str:
    return "" if low is None or high is None else f"{low:.2f} to {high:.2f}"


def _with_range(value: Number, low: Number, high: Number) -> str:
    return "–" if value is None else f"{value:.2f} ({_range(low, high)})"
