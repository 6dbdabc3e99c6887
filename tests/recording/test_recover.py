"""Recordings that were cut: whatever is left of them can be read by the usual readers."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from coheft.app.cli.main import EXIT_CONVERGED, EXIT_ERROR, EXIT_USAGE, run_command_line
from coheft.app.recording.mcap_records import MAGIC
from coheft.app.recording.reader import read_recording
from coheft.app.recording.recover import recover
from coheft.errors import RecordingError
from tests.recording.runs import news_of_a_run, record, same
from tests.synthetic_run import BLOCK

BLOCKS = 6
NEWS = news_of_a_run(BLOCKS)
FLUSHED = (1, 17, len(NEWS))
"""After so many of them ``record`` flushes."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole") / "run.mcap", NEWS)


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As somebody leaves it who is killed just after all was flushed."""
    return record(tmp_path_factory.mktemp("cut") / "run.mcap", NEWS, finish=False)


@pytest.fixture(scope="module")
def sizes(cut: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[int, int]:
    """Of the file when it had been flushed, by the number of news in it."""
    files = {n: record(tmp_path_factory.mktemp("part") / "run.mcap", NEWS[:n], finish=False) for n in FLUSHED}
    assert all(cut.read_bytes().startswith(file.read_bytes()) for file in files.values())
    return {n: file.stat().st_size for n, file in files.items()}


@pytest.fixture(scope="module")
def heads(cut: Path) -> set[int]:
    """The bytes that tell what the file's records are and how long: nothing protects them.

    Readers have to skip what they do not know, so a chunk whose head is damaged is left out, and reading goes on.
    """
    content = cut.read_bytes()
    found, start = set[int](), len(MAGIC)
    while start < len(content):
        found |= set(range(start, start + 9))
        start += 9 + int.from_bytes(content[start + 1 : start + 9], "little")
    return found


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch")


def test_all_that_was_flushed_is_saved(cut: Path, tmp_path: Path) -> None:
    before = cut.read_bytes()
    saved = recover(cut, tmp_path / "saved.mcap")
    assert saved is not None
    assert saved.until == pytest.approx(BLOCKS * BLOCK)
    assert cut.read_bytes() == before
    assert list(tmp_path.iterdir()) == [tmp_path / "saved.mcap"]
    recording = read_recording(tmp_path / "saved.mcap")
    assert all(same(one, other) for (_, one), other in zip(recording.news, NEWS, strict=True))
    assert set(recording.versions) > {"coheft", "mujoco"}
    with AnyReader([tmp_path / "saved.mcap"]) as reader:
        assert reader.message_count == saved.messages == len(list(reader.messages()))
    with (tmp_path / "saved.mcap").open("rb") as file:
        assert len(list(make_reader(file).iter_messages())) == saved.messages


def test_a_file_whose_first_record_is_not_known_is_read_after_it(cut: Path, tmp_path: Path) -> None:
    content = bytearray(cut.read_bytes())
    content[len(MAGIC)] = 0x80  # an opcode that readers have to skip
    (tmp_path / "damaged.mcap").write_bytes(content)
    saved = recover(tmp_path / "damaged.mcap", tmp_path / "saved.mcap")
    assert saved is not None
    with (tmp_path / "saved.mcap").open("rb") as file:
        assert len(list(make_reader(file).iter_messages())) == saved.messages > 0


@given(data=st.data())
def test_a_file_that_is_cut_or_damaged_anywhere_is_read_up_to_there(
    cut: Path, sizes: dict[int, int], heads: set[int], scratch: Path, data: st.DataObject
) -> None:
    content = bytearray(cut.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    is_cut = data.draw(st.booleans())
    in_head = not is_cut and place in heads
    if is_cut:
        del content[place:]
    else:
        content[place] ^= data.draw(st.integers(1, 255))
    damaged, output = scratch / "damaged.mcap", scratch / "saved.mcap"
    damaged.write_bytes(content)
    try:
        saved = recover(damaged, output, overwrite=True)
    except RecordingError:
        assert place < sizes[1]
        return
    assert saved is not None
    with output.open("rb") as file:
        assert len(list(make_reader(file).iter_messages())) == saved.messages
    try:
        news = [message for _, message in read_recording(output).news]
    except RecordingError:
        assert place < sizes[1] or in_head
        return
    if in_head:
        assert all(any(same(one, other) for other in NEWS) for one in news)
        return
    assert all(same(one, other) for one, other in zip(news, NEWS, strict=False))
    assert max([0, *(n for n, size in sizes.items() if place >= size)]) <= len(news) <= len(NEWS)


@pytest.mark.parametrize(
    ("kind", "place", "flipped"),
    [(6, 32, 0x80), (6, 57, 0x80), (7, 0, 7 ^ 5)],
    ids=["uncompressed size of a chunk", "sizes in a chunk's compressed data", "an index for a message"],
)
def test_damage_that_the_libraries_stumble_over_is_told(
    cut: Path, tmp_path: Path, kind: int, place: int, flipped: int
) -> None:
    content, start = cut.read_bytes(), len(MAGIC)
    output = tmp_path / "saved.mcap"
    count = 0
    while start < len(content):
        if content[start] == kind:
            count += 1
            damaged = bytearray(content)
            damaged[start + place] ^= flipped
            (tmp_path / "damaged.mcap").write_bytes(damaged)
            with suppress(RecordingError):
                recover(tmp_path / "damaged.mcap", output, overwrite=True)
                read_recording(output)
        start += 9 + int.from_bytes(content[start + 1 : start + 9], "little")
    assert count > 1


@settings(max_examples=20)
@given(tail=st.binary(max_size=200))
def test_rubbish_at_the_end_spoils_nothing(cut: Path, scratch: Path, tail: bytes) -> None:
    damaged, output = scratch / "damaged.mcap", scratch / "saved.mcap"
    damaged.write_bytes(cut.read_bytes() + tail)
    recover(damaged, output, overwrite=True)
    assert len(read_recording(output).news) == len(NEWS)


def test_an_unfinished_recording_is_refused_with_a_hint(cut: Path) -> None:
    with pytest.raises(RecordingError, match=f"no end.*coheft recover {cut}"):
        read_recording(cut)


@pytest.mark.parametrize(("content", "complaint"), [(b"", "empty"), (b"{}" * 50, "no MCAP file"), (None, "No such")])
def test_what_is_no_recording_is_refused(content: bytes | None, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=complaint):
        read_recording(path)
    with pytest.raises(RecordingError, match=complaint):
        recover(path, tmp_path / "saved.mcap")
    assert not (tmp_path / "saved.mcap").exists()


def test_the_command(cut: Path, whole: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(cut.read_bytes())
    assert run_command_line(["recover", str(path)]) == EXIT_CONVERGED
    assert "up to 0.12 s of the run" in capfd.readouterr().out
    assert len(read_recording(tmp_path / "run-recovered.mcap").news) == len(NEWS)

    assert run_command_line(["recover", str(path)]) == EXIT_ERROR
    assert "--overwrite" in capfd.readouterr().err
    assert run_command_line(["recover", str(path), "--output", str(path)]) == EXIT_ERROR
    assert path.read_bytes() == cut.read_bytes()
    assert run_command_line(["recover", str(path), "--output", str(path), "--overwrite"]) == EXIT_CONVERGED
    assert len(read_recording(path).news) == len(NEWS)

    assert run_command_line(["recover", str(whole)]) == EXIT_CONVERGED
    assert "nothing to do" in capfd.readouterr().out
    assert run_command_line(["recover", str(path), "--output", str(tmp_path / "no" / "x.mcap")]) == EXIT_USAGE
