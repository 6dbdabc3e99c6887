"""Recordings without and with faults: which does ``coheft identify`` accept, and which causes does it name?

*good*: how many are refuted (at most 1 %).
*listed*: with one fault of random kind and size: how many are accepted with an error above five of its standard
deviations, hidden errors included (at most 0.5 %); how many get the right cause if the margin is above 10 (95 %), and
the right robot of three or more (98 %); how many are within five standard deviations with ``--assume`` (99 %).
*unlisted*: with another fault, or two: how many are refuted (95 %).

Every second recording has twists and accelerations, if the fault allows. Seeds that are in the log are not repeated.
The bars count for seeds that nothing was tuned on.
"""

import time
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from benchmarks.command import run_command
from benchmarks.drawn_recordings import KINDS, draw_team, recorded
from benchmarks.recording_faults import LISTED, UNLISTED, Faulty, faulty
from coheft.app.identify.choices import Method, Options
from coheft.app.identify.methods import identify
from coheft.errors import RecordingError
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.judge.mend import MENDABLE
from coheft.estimation.batch.judge.verdict import ALL
from coheft.estimation.batch.recording import Recording

_FAR, _SURE, _ROBOTS = 5.0, 10.0, 3


class Trial(msgspec.Struct):
    """Result of one recording.

    Attributes:
        kind: Kind of noise, or of the fault.
        by_twists: Whether twists and accelerations were recorded instead of poses.
        seconds: CPU time of the identification [s].
        is_refuted: Whether the recording was refuted or refused.
        cause: The named cause.
        is_right: Whether cause and robot are right, or the robot is among those that are named; None if there is none
            to name.
        is_open: Whether several robots are named.
        margin: Margin over the second best cause.
        off: Largest error in standard deviations of an accepted result, or of one with ``--assume``.
    """

    seed: int
    kind: str
    by_twists: bool
    robots: int
    seconds: float
    is_refuted: bool
    cause: str = ""
    is_right: tuple[bool, bool] | None = None
    is_open: bool = False
    margin: float = 0.0
    off: float | None = None
    words: str = ""


def main(
    what: Literal["good", "listed", "unlisted"] = "listed",
    *,
    count: int = 400,
    first: int = 1,
    method: Literal["pose", "likelihood", "instruments"] | None = None,
    calibrate: bool = False,
    log: Path | None = None,
) -> None:
    """Try recordings, print each wrong result, and a summary.

    Args:
        what: Which recordings.
        count: Number of recordings.
        first: Seed of the first; the others follow consecutively.
        method: One of the methods that suit.
        calibrate: Whether calibration errors are estimated along where there are poses, which all recordings then have.
        log: File to which results are appended.
    """
    trials: list[Trial] = []
    if log is not None and log.exists():
        trials = [msgspec.json.decode(line, type=Trial) for line in log.read_bytes().splitlines()]
    for seed in range(first, first + count):
        if any(trial.seed == seed for trial in trials):
            continue
        trial = try_recording(what, seed, method, calibrate=calibrate)
        trials.append(trial)
        if log is not None:
            with log.open("ab") as file:
                file.write(msgspec.json.encode(trial) + b"\n")
        if not _is_well(what, trial):
            print(trial, flush=True)
        if len(trials) % 20 == 0:
            print(summary(what, trials), flush=True)
    print(summary(what, trials))


def try_recording(what: str, seed: int, method: Method | None = None, *, calibrate: bool = False) -> Trial:
    """Draw a recording, identify it, and compare the result with the truth; options as of ``main``."""
    method = "pose" if calibrate else method
    by_twists = method != "pose" and (method is not None or seed % 2 == 0)
    if what == "good":
        noise = KINDS[seed // 2 % len(KINDS)]
        kind: str = noise
        case = Faulty(recorded(draw_team(seed), noise, by_twists=by_twists), (), None)
    else:
        kinds = LISTED if what == "listed" else UNLISTED
        kind = kinds[seed // 2 % len(kinds)]
        case = faulty(kind, seed, by_twists=by_twists)
    recording = case.recording
    options = Options(method=None if recording.has("pose") else method, calibrate=calibrate and recording.has("pose"))
    trial = Trial(seed, kind, not recording.has("pose"), len(recording.names), 0.0, is_refuted=True)
    start = time.process_time()
    try:
        found = identify(recording, options)
    except RecordingError as error:
        trial.words = str(error)
        return trial
    finally:
        trial.seconds = time.process_time() - start
    trial.is_refuted = bool(found.doubts)
    verdict = found.verdict
    if not trial.is_refuted:
        trial.off = deviations(recording, found)
    elif verdict is None or not verdict.is_refuted:
        trial.words = found.doubts[0]
    else:
        trial.is_open = bool(verdict.rivals)
        trial.cause, trial.margin, trial.words = str(verdict.cause), verdict.margin, verdict.words
        if case.causes:
            trial.is_right = verdict.cause in case.causes, (case.robot or ALL) in verdict.candidates
        is_told = not verdict.is_open or (case.robot is None and not verdict.rivals)
        if trial.is_right is not None and trial.is_right[0] and verdict.cause in MENDABLE and is_told:
            adopted = identify(recording, replace(options, assume=verdict.cause))
            trial.off = None if adopted.doubts else deviations(recording, adopted)
    return trial


def deviations(recording: Recording, found: Identification) -> float:
    """Return the largest error of a known quantity, in standard deviations with hidden errors included."""
    assert recording.truth is not None
    hidden = np.array([error.std for error in found.hidden]) if found.hidden else np.zeros(10)
    error = np.abs(found.payload.inertia.central() - recording.truth.loads[0][1].central())
    ratios = error / np.hypot(found.payload.std, hidden)
    seen = [found.payload.is_seen(quantity) for quantity in ("mass", "com", "inertia")]
    known = np.repeat(seen, [1, 3, 6])
    return float(ratios[known].max()) if known.any() else 0.0


def _is_well(what: str, trial: Trial) -> bool:
    if what == "good":
        return not trial.is_refuted and (trial.off or 0.0) < _FAR
    if what == "unlisted":
        return trial.is_refuted
    right = trial.is_right is None or (trial.is_right[0] and (trial.is_right[1] or trial.robots < _ROBOTS))
    return right and (trial.off or 0.0) < _FAR


def summary(what: str, trials: list[Trial]) -> str:
    """Return a summary in one line."""
    refuted = [trial for trial in trials if trial.is_refuted]
    wrong = [trial for trial in trials if not trial.is_refuted and (trial.off or 0.0) > _FAR]
    named = [trial.is_right for trial in refuted if trial.is_right is not None and trial.margin > _SURE]
    whose = [
        trial.is_right[1]
        for trial in refuted
        if trial.is_right is not None and trial.is_right[0] and trial.robots >= _ROBOTS
    ]
    adopted = [trial.off < _FAR for trial in refuted if trial.off is not None]
    seconds = np.array([trial.seconds for trial in trials])
    words = [
        f"{what}: {len(trials)} recordings, {len(refuted)} refuted",
        f"{len(wrong)} accepted though wrong by more than {_FAR:g} std",
        f"processor time {np.median(seconds):.1f} s, worst {seconds.max():.1f} s",
    ]
    if named:
        words.append(f"named rightly {sum(one[0] for one in named)} of {len(named)} with a margin above {_SURE:g}")
    if whose:
        several = sum(trial.is_open for trial in refuted if trial.is_right is not None and trial.robots >= _ROBOTS)
        words.append(f"robot right {sum(whose)} of {len(whose)} ({several} times among several)")
    if adopted:
        words.append(f"adopted within {_FAR:g} std {sum(adopted)} of {len(adopted)}")
    return "; ".join(words)


if __name__ == "__main__":
    run_command(main, __doc__)
