"""The report of a recorded run."""

from pathlib import Path

import msgspec

from coheft.app.figures import picture_folder
from coheft.app.recording.reader import read_recording
from coheft.app.results.record import Record
from coheft.app.results.report import build_report
from coheft.app.run_report.folder import write_folder
from coheft.app.run_report.series import SeriesFollower
from coheft.app.study.bounds import with_bound
from coheft.errors import RecordingError
from coheft.wire.former_names import as_present
from coheft.wire.scenario.schema import Scenario


def report_recording(path: Path, folder: Path) -> Path:
    """Write the page, pictures and data of a recording into a folder; return the path of the page.

    A recording that cannot be read, or holds too little of a run, raises a ``RecordingError``.
    """
    recording = read_recording(path)
    scenario = _scenario(path, recording.scenario)
    record = Record.of(scenario, recording.begin.scene, with_history=True)
    follower = SeriesFollower()
    follower.is_live = False
    follower.begin(recording.begin)
    for _, news in recording.news:
        follower.receive(news)
        record.receive(news)
    if record.truth is None or record.silent:
        raise RecordingError(f"{path}: it ends before every robot had said something: there is nothing to report")
    report = with_bound(build_report(scenario, record), scenario, record.truth)
    with picture_folder(folder, "report"):
        return write_folder(folder, scenario, None, follower.series, report)


def _scenario(path: Path, text: str) -> Scenario:
    try:
        return msgspec.convert(as_present(msgspec.json.decode(text), str(path)), Scenario)
    except (msgspec.MsgspecError, AttributeError, TypeError) as error:
        raise RecordingError(
            f"{path}: it does not say what was run, or not in the words of this release: {error}"
        ) from error
