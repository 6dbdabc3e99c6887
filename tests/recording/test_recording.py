"""What is in a recording, read back by libraries that know nothing of us."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

import coheft
from coheft.app.cli.base import EXIT_ERROR, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.recording import reader as reader_module
from coheft.app.recording.mcap_file import COPY
from coheft.app.recording.reader import read_recording
from coheft.app.recording.recorder import Recorder
from coheft.app.results.judge import Judge
from coheft.app.run.broken_off import BrokenOff
from coheft.app.run.news import News
from coheft.errors import RecordingError
from coheft.estimation.geometry.spatial import Pose, rotation_exp
from coheft.estimation.measurement import ACCELERATION, TWIST, WRENCH
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.schema import Scenario
from tests import synthetic_run
from tests.recording.runs import BEGIN, SCENARIO, mistaken_for, news_of_a_run, record, same
from tests.synthetic_run import BLOCK, GRASPS, HEAVY, LIGHT, ROBOTS, STD

NEWS = news_of_a_run()
LAYOUT = Path(__file__).parents[2] / "docs" / "foxglove-layout.json"


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("recording") / "run.mcap", NEWS)


@pytest.fixture(scope="module")
def topics(path: Path) -> Mapping[str, list[tuple[int, Any]]]:
    """Log time [ns] and message, by topic."""
    found = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, time, data in reader.messages():
            found[connection.topic].append((time, reader.deserialize(data, connection.msgtype)))
    return found


def numbers(message: Any) -> list[float]:
    """All numbers of a message, in the order of its fields."""
    if isinstance(message, float | int):
        return [message]
    if isinstance(message, np.ndarray):
        return list(message.tolist())
    fields = [name for name in vars(message) if name not in ("header", "__msgtype__")]
    return [number for name in fields for number in numbers(getattr(message, name))]


def test_a_replay_is_exact(path: Path) -> None:
    recording = read_recording(path)
    assert same(recording.begin, BEGIN)
    assert len(recording.news) == len(NEWS)
    for (time, replayed), heard in zip(recording.news, NEWS, strict=True):
        assert same(replayed, heard)
        if isinstance(heard, Truth | Estimate):
            assert time == heard.time
    assert msgspec.json.decode(recording.scenario, type=Scenario) == SCENARIO


def test_versions_are_recorded(path: Path) -> None:
    with path.open("rb") as file:
        (versions,) = [each.metadata for each in make_reader(file).iter_metadata() if each.name == "versions"]
    assert versions["coheft"] == coheft.__version__
    assert set(versions) == {
        "coheft",
        "python",
        "system",
        "mujoco",
        "numpy",
        "scipy",
        "msgspec",
        "eclipse-zenoh",
    }


def test_the_mcap_library_agrees(path: Path) -> None:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert len(list(reader.iter_messages())) == summary.statistics.message_count > 0
        for schema, channel, _ in reader.iter_messages():
            assert schema is not None, "PlotJuggler cannot open a file with topics without schema"
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        assert {attachment.name for attachment in reader.iter_attachments()} == {
            reader_module.SCENARIO,
            reader_module.BEGIN,
        } | {COPY}
        assert [metadata.name for metadata in reader.iter_metadata()] == ["versions"]


def test_what_robots_measured_is_in_their_own_frames(topics: Mapping[str, list[tuple[int, Any]]]) -> None:
    truths = [news for news in NEWS if isinstance(news, Truth)]
    rate = SCENARIO.sensors.rate
    for k, name in enumerate(ROBOTS):
        for channel, order, columns in (("wrench", [0, 1, 2, 3, 4, 5], WRENCH), ("twist", [3, 4, 5, 0, 1, 2], TWIST)):
            for (time, message), truth in zip(topics[f"/{name}/measured/{channel}"], truths, strict=True):
                assert numbers(message) == truth.samples[k, columns][order].tolist()
                assert message.header.frame_id == name
                assert time == round(truth.time * 1e9)
                stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
                assert stamp == pytest.approx(truth.time - 1.0 / rate), "when the block's last sample was taken"
        for (_, message), truth in zip(topics[f"/{name}/measured/acceleration"], truths, strict=True):
            assert numbers(message.accel.linear) == truth.samples[k, ACCELERATION].tolist()
            assert np.isnan(numbers(message.accel.angular)).all(), "it is not measured"


def test_the_true_payload_and_where_it_is(topics: Mapping[str, list[tuple[int, Any]]]) -> None:
    (_, static), *more = topics["/tf_static"]
    assert not more
    assert [transform.child_frame_id for transform in static.transforms] == ROBOTS
    for transform in static.transforms:
        assert transform.header.frame_id == "payload"
        grasp = GRASPS[transform.child_frame_id]
        assert numbers(transform.transform.translation) == grasp.translation.tolist()
        rotation = Rotation.from_quat(numbers(transform.transform.rotation)).as_matrix()
        np.testing.assert_allclose(rotation, grasp.rotation, atol=1e-12)
    truths = [news for news in NEWS if isinstance(news, Truth)]
    rows = [topics[topic] for topic in ("/tf", "/payload/pose", "/payload/inertia", "/payload/total_wrench")]
    for truth, (_, tf), (_, pose), (_, inertia), (_, total) in zip(truths, *rows, strict=True):
        (moving,) = tf.transforms
        assert (moving.header.frame_id, moving.child_frame_id) == ("world", "payload")
        w, x, y, z = truth.quaternion.tolist()
        assert numbers(moving.transform) == numbers(pose.pose) == [*truth.position.tolist(), x, y, z, w]
        tensor = truth.payload.tensor[np.triu_indices(3)].tolist()
        assert numbers(inertia.inertia) == [truth.payload.mass, *truth.payload.com.tolist(), *tensor]
        assert numbers(total.wrench) == truth.total_wrench.tolist()
        assert total.header.frame_id == "payload"
    assert [len(message.markers) for _, message in topics["/payload/markers"]] == [
        1 + len(SCENARIO.payload.boxes), 2 + len(SCENARIO.payload.boxes),
    ]  # fmt: skip


def test_beliefs_errors_and_what_robots_make_of_them(topics: Mapping[str, list[tuple[int, Any]]]) -> None:
    judge = Judge(BEGIN.scene, [news for news in NEWS if isinstance(news, Truth)])
    for name in ROBOTS:
        estimates = [news for news in NEWS if isinstance(news, Estimate) and news.robot == name]
        rows = [topics[f"/{name}/{kind}/payload"] for kind in ("estimate", "error", "three_sigma")]
        for estimate, (time, believed), (_, error), (_, spread) in zip(estimates, *rows, strict=True):
            assert time == round(estimate.time * 1e9)
            report = judge.robot(estimate)
            assert believed.inertia.m == report.mass.estimate
            assert [believed.inertia.com.x, believed.inertia.com.y, believed.inertia.com.z] == report.com.estimate
            payload = LIGHT if estimate.block < 10 else HEAVY
            seen, true = (each.transported(GRASPS[name].inverse()) for each in (mistaken_for(payload), payload))
            com, tensor = seen.com - true.com, (seen.tensor - true.tensor)[np.triu_indices(3)]
            assert numbers(error.inertia) == pytest.approx([0.1 * payload.mass, *com, *tensor], abs=1e-12)
            xx, yy, zz, xy, xz, yz = STD[4:]
            assert numbers(spread.inertia) == pytest.approx(3 * np.array([*STD[:4], xx, xy, xz, yy, yz, zz]))
        totals = topics[f"/{name}/error/total_wrench"]
        assert len(totals) == sum(estimate.total_block >= 0 for estimate in estimates)
        for _, message in totals:
            stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            block = round((stamp + 1.0 / SCENARIO.sensors.rate) / BLOCK) - 1
            expected = 0.1 * GRASPS[name].inverse().adjoint() @ judge.truth_at(block).total_wrench
            assert numbers(message.wrench) == pytest.approx(expected.tolist())


def test_everything_that_the_foxglove_layout_shows_is_in_a_recording(
    topics: Mapping[str, list[tuple[int, Any]]],
) -> None:
    layout = json.loads(LAYOUT.read_text())
    shown, panels = json.dumps(layout["layout"]), set()
    for name, config in layout["configById"].items():
        assert f'"{name}"' in shown
        panels.add(name.partition("!")[0])
        for path in [path["value"] for path in config.get("paths", [])]:
            topic, *fields = path.removesuffix(".@negative").split(".")
            value = topics[topic][-1][1]
            for field in fields:
                value = getattr(value, field)
            assert isinstance(value, float)
        assert set(config.get("topics", {})) <= set(topics)
        assert config.get("topicToRender", "/rosout") in topics
    assert panels == {"3D", "Plot", "RosOut", "DiagnosticSummary"}


def test_covariance_of_a_pose_is_in_the_order_of_ros(tmp_path: Path) -> None:
    asked = news_of_a_run(1)
    assert isinstance(asked[0], Estimate)
    pose = msgspec.structs.replace(asked[0].poses["r2"], covariance=np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    asked[0] = msgspec.structs.replace(asked[0], poses={"r2": pose})
    with AnyReader([record(tmp_path / "run.mcap", asked)]) as reader:
        wanted = [each for each in reader.connections if each.topic == "/r1/estimate/poses/r2"]
        ((_, _, data),) = reader.messages(wanted)
        message: Any = reader.deserialize(data, wanted[0].msgtype)
    assert np.diag(message.pose.covariance.reshape(6, 6)).tolist() == [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]
    assert numbers(message.pose.pose.position) == pose.translation.tolist()


def test_a_settled_pose_is_there_with_how_far_it_is_off_and_how_far_its_robot_expects(tmp_path: Path) -> None:
    off = Pose(rotation_exp(np.array([0.0, 0.1, 0.0])), np.array([0.012, 0.0, 0.016]))
    news: list[News] = []
    for block in (0, 1):
        phase: Literal["poses", "inertia"] = "inertia" if block else "poses"
        believed = synthetic_run.estimate("r1", block, LIGHT, pose_error=off, phase=phase)
        pose = msgspec.structs.replace(believed.poses["r2"], covariance=np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
        news += [synthetic_run.truth(block, LIGHT), msgspec.structs.replace(believed, poses={"r2": pose})]
    found = {}
    with AnyReader([record(tmp_path / "run.mcap", news)]) as reader:
        for connection, time, data in reader.messages():
            if connection.msgtype == "std_msgs/msg/Float64":
                message: Any = reader.deserialize(data, connection.msgtype)
                assert time == round(2 * BLOCK * 1e9), "before, the pose was not settled"
                found[connection.topic] = message.data
    assert found == pytest.approx(
        {
            "/r1/error/poses/r2/rotation_deg": np.degrees(0.1),
            "/r1/error/poses/r2/translation_mm": 20.0,
            "/r1/three_sigma/poses/r2/rotation_deg": 3.0 * np.degrees(np.sqrt(6.0)),
            "/r1/three_sigma/poses/r2/translation_mm": 3e3 * np.sqrt(15.0),
        }
    )


def test_the_log_and_diagnostics_tell_what_happened(topics: Mapping[str, list[tuple[int, Any]]]) -> None:
    lines = [(line.name, line.msg) for _, line in topics["/rosout"]]
    assert ("server", "load 1 of 3 kg is added at (0, 0.1, 0.1) m") in lines
    assert ("r1", "notices at 0.22 s that the load has changed") in lines
    assert ("r2", "refused something") in lines
    assert len(topics["/diagnostics"]) == sum(isinstance(news, Estimate) for news in NEWS)
    (status,) = topics["/diagnostics"][0][1].status
    values = {pair.key: pair.value for pair in status.values}
    assert status.name in ROBOTS
    assert values["phase"] == "inertia"


def test_what_is_not_known_is_not_a_number(tmp_path: Path) -> None:
    news = news_of_a_run(1)
    assert isinstance(news[0], Estimate)
    assert news[0].payload is not None
    claimed = msgspec.structs.replace(news[0].payload, com=None, tensor=None, covariance=np.array([[0.04]]))
    news[0] = msgspec.structs.replace(news[0], payload=claimed)
    with AnyReader([record(tmp_path / "run.mcap", news)]) as reader:
        for topic, mass in (("estimate", 1.1 * HEAVY.mass), ("error", 0.1 * HEAVY.mass), ("three_sigma", 0.6)):
            wanted = [each for each in reader.connections if each.topic == f"/r1/{topic}/payload"]
            ((_, _, data),) = reader.messages(wanted)
            message: Any = reader.deserialize(data, wanted[0].msgtype)
            assert message.inertia.m == pytest.approx(mass)
            assert np.isnan(numbers(message.inertia)[1:]).all()


def test_the_recorder_finishes_its_file_whatever_happens(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with contextlib.suppress(KeyboardInterrupt), Recorder(path, SCENARIO) as recorder:
        recorder.begin(BEGIN)
        for news in NEWS:
            recorder.receive(news)
        raise KeyboardInterrupt
    assert len(read_recording(path).news) == len(NEWS)


def test_a_run_that_never_began_leaves_no_file(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap", SCENARIO):
        assert (tmp_path / "run.mcap").exists(), "so no one else takes the name"
    assert list(tmp_path.iterdir()) == []


def test_no_file_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_text("precious")
    with pytest.raises(RecordingError, match="exists already"):
        Recorder(tmp_path / "run.mcap", SCENARIO)
    assert run_command_line(["run", "ring3", "--record", str(tmp_path / "run.mcap")]) == EXIT_USAGE
    assert (tmp_path / "run.mcap").read_text() == "precious"


def test_without_its_packages_a_recording_is_refused_before_anything_starts(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['rosbags'] = None\n"
        "from coheft.app.cli.main import run_command_line\n"
        f"sys.exit(run_command_line(['run', 'ring3', '--record', {str(tmp_path / 'run.mcap')!r}]))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == EXIT_ERROR
    assert "this needs the package 'rosbags': install 'coheft[record]'" in run.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is full")
def test_a_run_goes_on_when_its_recording_cannot(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", SCENARIO)
    recorder._file.close()
    recorder._file = open("/dev/full", "wb")  # noqa: SIM115
    assert recorder.problem == ""
    with recorder:
        recorder.begin(BEGIN)
        while recorder._thread.is_alive():  # until it has found the disk full
            for news in NEWS:
                recorder.receive(news)
        for news in NEWS:
            recorder.receive(news)
    assert "run.mcap: could no longer be written: No space left" in recorder.problem
    broken_off = BrokenOff({"record": tmp_path / "run.mcap"}, tmp_path, recorder)
    for news in NEWS:
        broken_off.receive(news)
    assert "holds what came until then" not in broken_off.sentence()
    assert "To save its content: coheft recover" in broken_off.sentence()
