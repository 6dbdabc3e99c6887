"""Recordings that were cut or damaged: whatever is left of them can be read by the usual readers."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.highlevel import AnyReader

from coheft.app.cli.base import EXIT_CONVERGED, EXIT_ERROR, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.recording.mcap_records import MAGIC
from coheft.app.recording.reader import read_recording
from coheft.app.recording.recover import recover
from coheft.errors import RecordingError
from tests.recording.runs import news_of_a_run, record, same
from tests.synthetic_run import BLOCK

BLOCKS = 6
NEWS = news_of_a_run(BLOCKS)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole") / "run.mcap", NEWS)


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As somebody leaves it who is killed just after all was flushed."""
    return record(tmp_path_factory.mktemp("cut") / "run.mcap", NEWS, finish=False)


@dataclass(frozen=True)
class WholeChunk:
    """Where it stands in a file [bytes], and its messages."""

    start: int
    end: int
    messages: list[Message]


def chunks_in(content: bytes) -> list[WholeChunk]:
    """All chunks of a file that is not damaged."""
    found, start = [], len(MAGIC)
    while start < len(content) - len(MAGIC):
        body, length = start + 9, int.from_bytes(content[start + 1 : start + 9], "little")
        if content[start] == Opcode.CHUNK:
            records = breakup_chunk(Chunk.read(ReadDataStream(BytesIO(content[body : body + length]))), True)
            messages = [record for record in records if isinstance(record, Message)]
            found.append(WholeChunk(start, body + length, messages))
        start = body + length
    return found


def messages_in(path: Path) -> list[Message]:
    with path.open("rb") as file:
        return [record for record in StreamReader(file, validate_crcs=True).records if isinstance(record, Message)]


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
    with AnyReader([tmp_path / "saved.mcap"]) as reader:
        assert reader.message_count == saved.messages == len(list(reader.messages()))
    with (tmp_path / "saved.mcap").open("rb") as file:
        content = make_reader(file)
        assert len(list(content.iter_messages())) == saved.messages
        assert [each.name for each in content.iter_metadata()] == ["versions"]


def test_a_file_whose_first_record_is_not_known_is_read_after_it(cut: Path, tmp_path: Path) -> None:
    content = bytearray(cut.read_bytes())
    content[len(MAGIC)] = 0x80  # an opcode that readers have to skip
    (tmp_path / "damaged.mcap").write_bytes(content)
    saved = recover(tmp_path / "damaged.mcap", tmp_path / "saved.mcap")
    assert saved is not None
    with (tmp_path / "saved.mcap").open("rb") as file:
        assert len(list(make_reader(file).iter_messages())) == saved.messages > 0


def test_a_chunk_is_found_whose_head_is_damaged(cut: Path, tmp_path: Path) -> None:
    content = bytearray(cut.read_bytes())
    chunks = chunks_in(content)
    for chunk in chunks:
        content[chunk.start : chunk.start + 9] = bytes([0x80, *b"\xff" * 8])
    (tmp_path / "damaged.mcap").write_bytes(content)
    assert recover(tmp_path / "damaged.mcap", tmp_path / "saved.mcap") is not None
    assert len(messages_in(tmp_path / "saved.mcap")) == sum(len(chunk.messages) for chunk in chunks)


@st.composite
def damages(draw: st.DrawFn, size: int) -> tuple[str, int, int, int]:
    """What kind, from where on, up to where, and which bit is flipped if it is one."""
    kind = draw(st.sampled_from(["bit", "zeros", "gone", "cut"]))
    start = draw(st.integers(0, size - 1))
    length = {"bit": 1, "cut": size}.get(kind) or draw(st.integers(1, 5000))
    return kind, start, min(size, start + length), draw(st.integers(0, 7)) if kind == "bit" else 0


@pytest.mark.parametrize("name", ["whole", "cut"])
@given(data=st.data())
def test_all_chunks_that_damage_has_not_touched_are_saved_and_the_loss_is_told(
    name: str, request: pytest.FixtureRequest, scratch: Path, data: st.DataObject
) -> None:
    content = request.getfixturevalue(name).read_bytes()
    kind, start, end, bit = data.draw(damages(len(content)))
    there = {"bit": bytes([content[start] ^ 1 << bit]), "zeros": bytes(end - start)}.get(kind, b"")
    damaged, output = scratch / "damaged.mcap", scratch / "saved.mcap"
    damaged.write_bytes(content[:start] + there + content[end:])
    chunks = chunks_in(content)
    untouched = [chunk for chunk in chunks if end <= chunk.start or start >= chunk.end]
    try:
        saved = recover(damaged, output, overwrite=True)
    except RecordingError:  # else it is not known as an MCAP file any more
        assert not any(chunk.messages for chunk in untouched) or start < len(MAGIC)
        return
    if saved is None:
        assert there == content[start:end]
        return
    found = {(message.log_time, message.data) for message in messages_in(output)}
    all_known = {(message.log_time, message.data) for chunk in chunks for message in chunk.messages}
    assert found <= all_known
    assert found >= {(message.log_time, message.data) for chunk in untouched for message in chunk.messages}
    for time, _ in all_known - found:
        is_cut_off = end == len(content) and time / 1e9 >= saved.until - BLOCK  # and no piece begins there
        assert is_cut_off or any(lost.after <= time / 1e9 <= lost.before for lost in saved.lost)
    with output.open("rb") as file:
        assert len(list(make_reader(file).iter_messages())) == saved.messages
    if kind == "bit":
        assert read_recording(output)


def test_what_has_lost_its_end_does_not_take_the_next_chunk_along(whole: Path, tmp_path: Path) -> None:
    """Four zeros in that chunk would pass for a checksum that was not computed; an index has none at all."""
    content = whole.read_bytes()
    chunks = chunks_in(content)
    gone, saved = tmp_path / "gone.mcap", tmp_path / "saved.mcap"
    for start, end in [(306, 3759), *((chunk.start - lost, chunk.start) for chunk in chunks for lost in (20, 40, 60))]:
        gone.write_bytes(content[:start] + content[end:])
        assert recover(gone, saved, overwrite=True)
        found = {(message.log_time, message.data) for message in messages_in(saved)}
        assert found >= {(message.log_time, message.data) for chunk in chunks for message in chunk.messages}


@pytest.mark.parametrize("name", ["whole", "cut"])
def test_no_flipped_bit_leaves_a_recording_that_cannot_be_shown(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Bits of chunks, attachments and of what stands between them; each was the end for one of the commands before."""
    content = request.getfixturevalue(name).read_bytes()
    places = [chunk.start + step for chunk in chunks_in(content) for step in (-1, 0, 3, 10, 30, 40, 44, 100)]
    for place in [0, 9, 20, *places, len(content) - 30, len(content) - 1]:
        damaged = bytearray(content)
        damaged[place] ^= 4
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        assert recover(tmp_path / "damaged.mcap", tmp_path / "saved.mcap", overwrite=True) is not None, place
        news = [message for _, message in read_recording(tmp_path / "saved.mcap").news]
        assert news
        assert all(any(same(one, other) for other in NEWS) for one in news)


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
        if content[start] == kind and count < 10:
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
    with pytest.raises(RecordingError, match=f"is incomplete.*coheft recover {cut}"):
        read_recording(cut)


@pytest.mark.parametrize(
    ("content", "complaint"), [(b"", "empty"), (b"{}" * 50, "not an MCAP file"), (None, "No such")]
)
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
    content = bytearray(whole.read_bytes())
    chunk = chunks_in(content)[1]
    content[(chunk.start + chunk.end) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=f"damaged.*coheft recover {path}"):
        read_recording(path)
    assert run_command_line(["recover", str(path), "--overwrite"]) == EXIT_CONVERGED
    told = capfd.readouterr().out
    assert f"lost {chunk.end - chunk.start} bytes, from byte {chunk.start} on: messages between 0.02 s and" in told
    assert len(read_recording(tmp_path / "run-recovered.mcap").news) < len(NEWS)
    path.unlink()
    assert run_command_line(["recover", str(path), "--output", str(tmp_path / "no" / "x.mcap")]) == EXIT_USAGE
