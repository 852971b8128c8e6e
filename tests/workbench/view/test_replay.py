"""Replay: what a page is told of a time, against the log and what was published."""

from __future__ import annotations

import base64
import json
import math
import urllib.error
import urllib.request
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from websockets.exceptions import InvalidStatus

from robotctl.messages.control import ControlState
from robotctl.runtime.flight.recorder import RecordHeader, framed
from robotctl.workbench.logs.rows import RecordingError
from tests.cli.command import status_of
from tests.workbench.view.recorded import (
    DRIVES_S,
    EPOCH_NS,
    FAULT_S,
    LOST_S,
    PERIOD_NS,
    SPEED_M_S,
    ServedReplay,
    pose_at,
    published,
    write_run,
)

SECONDS = 20
TOPICS = {
    "ControlState": "control",
    "NavigationState": "navigation",
    "LocalisationState": "localisation",
    "LidarScan": "lidar",
    "ParticleCloud": "particles",
    "PlanView": "path",
    "GivenMap": "map",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run") / "drive", SECONDS, files=3)


@pytest.fixture
def served(folder):
    with ServedReplay(folder) as served:
        yield served


def newest_by_mcap(folder, topic: str, at_ns: int) -> tuple[int, dict] | None:
    """Return time and content of the newest message of a topic, as the mcap package reads it."""
    found = []
    for path in sorted(folder.glob("robot-*.mcap")):
        with path.open("rb") as file:
            messages = make_reader(file).iter_messages([topic], ending_at=at_ns)
            found += [(message.log_time, json.loads(message.data)) for _, _, message in messages]
    return max(found, key=lambda each: each[0], default=None)


def get(served, path: str, **headers) -> tuple[int, bytes]:
    request = urllib.request.Request(served.url + path, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=30.0) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_hello_says_that_it_is_a_replay_and_of_what_time(served):
    with served.client() as client:
        replay = client.hello["replay"]
        assert replay["name"] == "drive"
        assert replay["begin_ns"] == EPOCH_NS
        assert replay["end_ns"] == EPOCH_NS + SECONDS * 10**9 - PERIOD_NS
        assert client.hello["role"] == "look"
        assert client.hello["name"] == "tester"
        assert [each["name"] for each in client.hello["sonars"]] == ["front"]


@pytest.mark.parametrize(
    "at_s", [0.0, 0.049, 0.05, 1.0, 3.33, 6.65, 6.7, 9.999, 11.0, 13.35, 14.0, 19.95]
)
def test_a_seek_shows_the_newest_of_each_topic_in_the_log(served, folder, at_s):
    at_ns = round(at_s * 1e9)
    with served.client() as client:
        picture = client.seek(at_ns)
    for name, topic in TOPICS.items():
        newest = newest_by_mcap(folder, topic, EPOCH_NS + at_ns)
        assert newest is not None
        assert picture[name]["stamp_ns"] == newest[0] - EPOCH_NS, name
    _, control = newest_by_mcap(folder, "control", EPOCH_NS + at_ns)
    assert picture["ControlState"]["x_m"] == control["T_odom_base"]["x_m"]
    assert picture["ControlState"]["distance_m"] == control["distance_m"]
    _, particles = newest_by_mcap(folder, "particles", EPOCH_NS + at_ns)
    packed = msgspec.convert(particles["data"], bytes, strict=False)
    assert picture["ParticleCloud"]["poses"] == packed


@pytest.mark.parametrize("at_s", [0.5, 8.0, 15.0])
def test_a_message_is_again_what_the_robot_published(served, at_s):
    at_ns = round(at_s * 1e9)
    newest = {type(each).__name__: each for each in published(SECONDS) if each.stamp_ns <= at_ns}
    with served.client() as client:
        picture = client.seek(at_ns)
    for name in TOPICS.keys() - {"PlanView", "LidarScan", "GivenMap"}:
        sent = msgspec.msgpack.decode(msgspec.msgpack.encode(newest[name]))
        assert repr(picture[name]) == repr(sent), name  # nan is not equal to itself
    scan, known = picture["LidarScan"], newest["LidarScan"]
    wanted = np.frombuffer(known.ranges, "<f4")
    assert np.frombuffer(scan["ranges"], "<f4") == pytest.approx(wanted, abs=1e-4, nan_ok=True)
    assert scan["step_rad"] == pytest.approx(known.step_rad)
    assert picture["PlanView"]["path"] == newest["PlanView"].path
    assert picture["PlanView"]["costs"]["cells"] == newest["PlanView"].costs.cells
    assert picture["GivenMap"]["map"]["cells"] == newest["GivenMap"].map.cells


def test_scrubbing_to_and_fro_shows_the_same_as_a_page_that_opens_there(served):
    rng = np.random.default_rng(3)
    with served.client() as scrubbing:
        for at_s in rng.uniform(0.0, SECONDS - 0.1, 20):
            picture = scrubbing.seek(round(at_s * 1e9))
            with served.client() as fresh:
                assert repr(fresh.picture()) == repr(picture)


def test_a_lost_robot_is_where_it_last_knew_to_be_and_not_where_its_localiser_guesses(served):
    assert get(served, "history")[0] == 200
    with served.client() as client:
        client.seek(round(5e9))
        client.send("Seek", at_ns=round((LOST_S[0] + 1.0) * 1e9))
        states = []
        while (message := client.receive())["type"] != "Playback":
            states += [message] if message["type"] == "LocalisationState" else []
        assert [each["status"] for each in states] == [1, 2]
        assert states[0]["stamp_ns"] == LOST_S[0] * 1e9 - PERIOD_NS


def test_the_history_is_path_states_and_notices_of_the_whole_run(served):
    status, body = get(served, "history")
    history = msgspec.msgpack.decode(body)
    assert status == 200
    assert history["driving_ns"] == DRIVES_S * 1e9
    stretches = [(each["begin_ns"], each["state"], each["reason"]) for each in history["stretches"]]
    assert stretches == [
        (0, 2, ""),
        (DRIVES_S * 1e9, 3, ""),
        (FAULT_S * 1e9, 4, "the motor is hot"),
    ]
    notices = [(each["stamp_ns"], each["text"]) for each in history["notices"]]
    assert notices == [(0, "it begins"), (FAULT_S * 1e9, "the motor is hot")]
    times_s = np.frombuffer(history["times_s"], "<f8")
    points = np.frombuffer(history["points"], "<f4").reshape(-1, 2)
    assert np.frombuffer(history["begins"], bool).tolist() == [True] + [False] * (len(points) - 1)
    wanted = [pose_at(each)[:2] for each in times_s]
    assert points == pytest.approx(np.array(wanted), abs=1e-5)
    assert points[-1, 0] > 1.0 + SPEED_M_S * (FAULT_S - DRIVES_S) - 0.03


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("ControlState.v_ref_m_s", math.sin),
        ("ControlState.duty[1]", lambda t_s: 0.001 * t_s),
        ("ControlState.x_m", lambda t_s: pose_at(t_s)[0]),
        ("ControlState.sonar_m[0]", lambda _: 1.5),
        ("ControlState.sonar_m[1]", lambda _: math.nan),
        ("ControlState.battery.charge", lambda _: 0.8),
        ("ControlState.nodes[0].boots", lambda _: 1.0),
        ("ControlState.omega_rad_s", lambda _: math.nan),
        ("LocalisationState.x_m", lambda t_s: 3.0 if LOST_S[0] <= t_s < LOST_S[1] else 0.0),
        ("NavigationState.items", lambda _: 3.0),
    ],
)
def test_a_plotted_field_is_there_over_the_whole_run(served, field, value):
    status, body = get(served, f"series?field={field}")
    (series,) = msgspec.msgpack.decode(body)
    times_s = np.frombuffer(series["times_s"], "<f8")
    period_s = PERIOD_NS / 1e9 * (2 if field.startswith("Navigation") else 1)
    assert (status, series["field"]) == (200, field)
    assert times_s == pytest.approx(np.arange(0.0, SECONDS, period_s))
    wanted = [value(each) for each in times_s]
    assert np.frombuffer(series["values"], "<f4") == pytest.approx(wanted, abs=1e-6, nan_ok=True)


def test_a_field_that_is_none_has_no_values(served):
    names = "&".join(
        f"field={each}"
        for each in ("ControlState.none[3].x", "Nothing.x", "ControlState.", "x", "ControlState.1")
    )
    status, body = get(served, f"series?{names}")
    assert status == 200
    for series in msgspec.msgpack.decode(body):
        assert np.isnan(np.frombuffer(series["values"], "<f4")).all()


def test_it_plays_at_the_rate_that_is_asked_for_and_stops_at_the_end(served):
    with served.client() as client:
        client.picture()
        client.send("Play", rate=50.0)
        seen = [client.picture()["Playback"]]
        while seen[-1]["is_playing"]:
            seen.append(client.picture()["Playback"])
        times = [each["at_ns"] for each in seen]
        assert times == sorted(times)
        assert times[-1] == SECONDS * 10**9 - PERIOD_NS
        assert client.known["ControlState"]["stamp_ns"] == times[-1]
        assert len(times) > 3
        client.send("Play", rate=0.5)
        assert client.picture(lambda each: each["is_playing"])["Playback"]["at_ns"] < 10**9
        client.send("Pause")
        assert not client.picture(lambda each: not each["is_playing"])["Playback"]["is_playing"]


def test_two_runs_have_one_time_from_their_beginnings_or_from_their_first_driving(tmp_path):
    one = write_run(tmp_path / "one", 16)
    late = write_run(tmp_path / "late", 4)  # of which the file below is a later beginning
    with (late / "robot-0001.mcap").open("rb") as file:
        messages = [(c, m) for _, c, m in make_reader(file).iter_messages()]
    cut_ns = 1_000_000_000
    copy_later(messages, late / "robot-0001.mcap", cut_ns)
    with ServedReplay(one, late) as served:
        for run in (0, 1):
            assert get(served, f"history?run={run}")[0] == 200
        with (
            served.client("/live?run=0") as first,
            served.client("/live?run=1") as second,
            served.client() as both,
        ):
            assert both.hello["replay"]["run"] is None
            both.send("Seek", at_ns=3 * 10**9)
            at = lambda playback: playback["at_ns"] == 3 * 10**9  # noqa: E731
            assert first.picture(at)["ControlState"]["distance_m"] == 3.0
            second.picture(lambda each: each["at_ns"] == 3 * 10**9 - PERIOD_NS)
            both.send("Align", by_driving=True)
            both.picture(lambda each: each["by_driving"])
            assert both.known["Playback"]["offsets_ns"] == [0, cut_ns]
            both.seek(round(DRIVES_S * 1e9))
            first.picture(lambda each: each["at_ns"] == DRIVES_S * 1e9)
            second.picture(lambda each: each["at_ns"] == DRIVES_S * 1e9 - cut_ns)
            for client in (first, second):
                assert client.known["ControlState"]["distance_m"] == DRIVES_S
        assert get(served, "history?run=2")[0] == 404
        assert get(served, "history")[0] == 404


def copy_later(messages, path, later_ns: int, **changes) -> None:
    """Write the messages of a log from a time after its beginning on, some fields changed."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library=changes.pop("library", "robotctl"))
        channels: dict[str, int] = {}
        for channel, message in messages:
            if message.log_time < EPOCH_NS + later_ns:
                continue
            if channel.topic not in channels:
                channels[channel.topic] = writer.register_channel(channel.topic, "json", 0)
            data = changes.get(channel.topic, lambda content: content)(json.loads(message.data))
            encoded = json.dumps(data).encode()
            writer.add_message(channels[channel.topic], message.log_time, encoded, message.log_time)
        writer.finish()


# Files of all kinds


def test_a_log_that_was_cut_is_shown_as_far_as_it_goes(tmp_path):
    folder = write_run(tmp_path / "cut", 8, files=2, is_cut=True)
    before = (folder / "robot-0002.mcap").read_bytes()
    with ServedReplay(folder) as served:
        assert any("was not closed" in each for each in served.runs[0].notes)
        with served.client() as client:
            assert client.seek(7_900_000_000)["ControlState"]["distance_m"] == 7.9
    assert (folder / "robot-0002.mcap").read_bytes() == before, "the recording itself is untouched"


def test_a_damaged_place_is_passed_over(tmp_path):
    folder = write_run(tmp_path / "damaged", 8)
    path = folder / "robot-0001.mcap"
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    data = bytearray(path.read_bytes())
    middle = chunks[4].chunk_start_offset + chunks[4].chunk_length // 2
    data[middle : middle + 64] = bytes(64)
    path.write_bytes(data)
    with ServedReplay(folder) as served, served.client() as client:
        at_ns = (chunks[4].message_start_time + chunks[4].message_end_time) // 2 - EPOCH_NS
        stamp_ns = client.seek(at_ns)["ControlState"]["stamp_ns"]
        assert chunks[3].message_start_time <= stamp_ns + EPOCH_NS <= chunks[3].message_end_time
        assert client.seek(7_900_000_000)["ControlState"]["distance_m"] == 7.9
        assert get(served, "history")[0] == 200


def test_a_log_of_another_version_is_shown_as_far_as_it_is_understood(tmp_path):
    folder = write_run(tmp_path / "old", 4)
    path = folder / "robot-0001.mcap"
    with path.open("rb") as file:
        messages = [(c, m) for _, c, m in make_reader(file).iter_messages()]

    def older(content):
        content |= content.pop("T_odom_base")
        content["sonar_m"] = [each.get("range_m") for each in content.pop("sonars")]
        content["something_new"] = {"a": [1]}
        del content["bus"], content["loop"]
        content["fault"] = 9999
        return content

    copy_later(
        messages,
        path,
        0,
        library="robotctl 0.0.1",
        control=older,
        localisation=lambda content: content | content.pop("T_world_odom"),
        navigation=lambda content: {"stamp_ns": content["stamp_ns"], "mode": 77},
        lidar=lambda _: {"nothing": "of it"},
    )
    header = RecordHeader("0.0.1", '{"robot": {"name": 1}}', 0.0, 0.0, 0.0)
    (folder / "control-0001.rec").write_bytes(framed(msgspec.msgpack.encode(header)))
    with ServedReplay(folder) as served:
        with served.client() as client:
            picture = client.seek(3_000_000_000)
        control = picture["ControlState"]
        assert control["x_m"] == pytest.approx(pose_at(3.0)[0])
        assert control["sonar_m"][0] == 1.5
        assert control["fault"] == 9999
        assert len(control) == len(ControlState.__struct_fields__) + 1
        assert picture["NavigationState"]["mode"] == 77
        history = msgspec.msgpack.decode(get(served, "history")[1])
        points = np.frombuffer(history["points"], "<f4").reshape(-1, 2)
        assert points[-1] == pytest.approx(pose_at(4.0)[:2], abs=0.03)
        (series,) = msgspec.msgpack.decode(get(served, "series?field=ControlState.x_m")[1])
        assert np.isfinite(np.frombuffer(series["values"], "<f4")).all()


def test_arc_obstacles_moving_things_and_the_body_are_shown_where_the_log_has_them(tmp_path):
    folder = write_run(tmp_path / "new", 3)
    path = folder / "robot-0001.mcap"
    with path.open("rb") as file:
        messages = [(c, m) for _, c, m in make_reader(file).iter_messages()]
    arc = np.array([[1.0, 2.0, 0.5], [1.5, 2.5, 0.6]], "<f4")
    places = np.array([[3.0, 1.0], [4.0, 1.5], [5.0, 2.0]], "<f4")
    corners = [(0.3, -0.2), (0.4, 0.0), (0.3, 0.2), (-0.1, 0.2), (-0.1, -0.2), (0.3, -0.2)]
    person = {
        "cylinders": [{"pose": {"position": {"x": 5.0, "y": 4.0, "z": 0.8}}}],
        "metadata": [
            {"key": name, "value": value}
            for name, value in (("vx_m_s", "0.300"), ("vy_m_s", "-0.100"), ("radius_m", "0.250"))
        ],
    }
    body = {"lines": [{"points": [{"x": x, "y": y, "z": 0.0} for x, y in corners]}]}
    contents = {
        "arc": cloud(arc, ["x", "y", "theta"]),
        "obstacles": cloud(places, ["x", "y"]),
        "moving": {"deletions": [], "entities": [person]},
        "outline": {"deletions": [], "entities": [body]},
    }
    channel, first = next(each for each in messages if each[0].topic == "path")
    for topic, content in contents.items():
        data = json.dumps(content).encode()
        messages.append((replace(channel, topic=topic), replace(first, data=data)))
    copy_later(messages, path, 0)
    with ServedReplay(folder) as served, served.client() as client:
        view = client.seek(2_000_000_000)["PlanView"]
        assert view["arc"] == arc.tobytes()
        assert view["obstacles"] == places.tobytes()
        assert view["moving"] == [[5.0, 4.0, 0.3, -0.1, 0.25]]
        ((body,),) = client.hello["bodies"]
        assert sorted(map(tuple, body)) == sorted(set(corners) - {(0.4, 0.0)})


def cloud(points, names) -> dict:
    """Return a `foxglove.PointCloud` of float32."""
    return {
        "point_stride": 4 * len(names),
        "fields": [{"name": name, "offset": 4 * n, "type": 7} for n, name in enumerate(names)],
        "data": base64.b64encode(points.tobytes()).decode(),
    }


def test_of_a_folder_with_several_runs_the_last_is_shown_and_the_others_are_named(tmp_path):
    folder = write_run(tmp_path / "many", 3)
    write_run(folder, 5, files=2, begin_ns=EPOCH_NS + 3600 * 10**9)
    with ServedReplay(folder) as served:
        (run,) = served.runs
        assert run.begin_ns == EPOCH_NS + 3600 * 10**9
        assert run.length_ns == 5 * 10**9 - PERIOD_NS
        assert any("2 runs" in each and "robot-0001.mcap" in each for each in run.notes)
    with ServedReplay(folder / "robot-0001.mcap") as served:
        assert served.runs[0].begin_ns == EPOCH_NS


def test_two_runs_in_virtual_time_are_two_though_each_begins_at_0(tmp_path):
    folder = write_run(tmp_path / "virtual", 12, files=2, begin_ns=0)
    write_run(folder, 5, begin_ns=0)
    with ServedReplay(folder) as served:
        assert served.runs[0].length_ns == 5 * 10**9 - PERIOD_NS


def test_a_run_begins_with_its_first_state_though_its_map_is_older(tmp_path):
    folder = write_run(tmp_path / "late", 4)
    path = folder / "robot-0001.mcap"
    with path.open("rb") as file:
        messages = [(c, m) for _, c, m in make_reader(file).iter_messages()]
    old_ns = EPOCH_NS - 600 * 10**9
    for number, (channel, message) in enumerate(messages):
        if channel.topic == "map":
            messages[number] = channel, replace(message, log_time=old_ns)
    copy_later(messages, path, -(10**12))
    with ServedReplay(folder) as served, served.client() as client:
        assert client.hello["replay"]["begin_ns"] == EPOCH_NS
        picture = client.seek(0)
        assert picture["ControlState"]["stamp_ns"] == 0
        assert picture["GivenMap"]["stamp_ns"] == old_ns - EPOCH_NS


def test_what_is_no_recording_is_refused_with_what_it_is(tmp_path):
    empty, text, other = (tmp_path / name for name in ("robot-1.mcap", "a.txt", "other.mcap"))
    empty.write_bytes(b"")
    text.write_text("nothing of the kind")
    with other.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("chatter", "json", 0)
        writer.add_message(channel, 5, b"{}", 5)
        writer.finish()
    (tmp_path / "folder").mkdir()
    for path, why in (
        (empty, "is empty"),
        (text, "no log of states"),
        (other, "no message of the topic `control`.*chatter"),
        (tmp_path / "folder", "no robot-"),
        (tmp_path / "missing", "no such file"),
    ):
        with pytest.raises(RecordingError, match=why):
            ServedReplay(path)
        assert status_of("view", str(path)) == 2


# Access


def test_foreign_pages_and_foreign_names_get_nothing(served):
    with pytest.raises(InvalidStatus), served.client(origin="http://elsewhere.example"):
        pass
    for path in ("", "history", "series?field=ControlState.v_m_s", "assets/page.js", "session"):
        assert get(served, path, Host="elsewhere.example")[0] == 403
    for path in ("assets/..%2f..%2fserver.py", "assets/../../server.py", "..%2f..%2fetc%2fpasswd"):
        assert get(served, path)[0] == 404


@pytest.mark.parametrize(
    "message",
    [
        "",
        "{}",
        '{"type":"Seek"}',
        '{"type":"Seek","at_ns":-1}',
        '{"type":"Play","rate":0}',
        '{"type":"ArmRequest","id":1,"at_ms":0,"arm":true}',
    ],
)
def test_what_no_replay_understands_ends_the_connection(served, message):
    with served.client() as client:
        client._connection.send(message)
        assert "1008" in client.closed()
