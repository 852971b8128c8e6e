"""Recordings by the page's server: who may have them, and that nothing else of the disk is had."""

from __future__ import annotations

import http.client
import os
import threading

import msgspec
import pytest
from mcap.reader import make_reader

from robotctl.app.processes.recordings import RecordingFolder
from robotctl.messages.recording import SetRecording
from robotctl.runtime.storage.ring_file import hold
from robotctl.web.access import Access, Role
from robotctl.web.desk import Desk
from robotctl.web.published import RecorderState
from robotctl.web.recordings import RecordingPages
from robotctl.web.robot_view import Now
from robotctl.web.wire import RecordRequest, Refused
from tests.web.conftest import Served
from tests.workbench.view.recorded import EPOCH_NS, PERIOD_NS, write_run

MS = 1_000_000
NOW = Now(1_000_000 * MS, 5_000 * MS)
AT_MS = NOW.server_ns / 1e6
TOKENS = {Role.LOOK: "l" * 43, Role.DRIVE: "d" * 43}


@pytest.fixture
def folder(tmp_path):
    folder = write_run(tmp_path / "logs", 4, files=2)
    (folder / "control-0001.rec").write_bytes(bytes(range(256)) * 4000)
    (folder / "fault-20260101T000000.000Z.rec").write_bytes(b"f")
    (folder / "passwords.txt").write_text("secret")
    (folder / "robot-0009.mcap.part").write_text("half")
    (folder / "robot-0008.mcap").symlink_to(tmp_path / "outside")
    (tmp_path / "outside").write_text("secret")
    (folder / "pictures-0001").mkdir()
    os.mkfifo(folder / "robot-0007.mcap")
    return folder


class Asked:
    """A server of recordings, and a browser's requests to it."""

    def __init__(self, served: Served) -> None:
        self._served = served

    def get(self, path: str, role: Role | None = Role.LOOK, **headers) -> tuple[int, dict, bytes]:
        """Return status, headers and body; the path is sent as it is."""
        connection = http.client.HTTPConnection("127.0.0.1", self._served.port, timeout=10.0)
        if role is not None:
            cookie = self._served.access.exchange(TOKENS[role])[1]
            headers["Cookie"] = f"{self._served.access.cookie}={cookie}"
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        body = answer.read()
        connection.close()
        return answer.status, {k.lower(): v for k, v in answer.getheaders()}, body


@pytest.fixture
def served_folder(static, folder, monkeypatch):
    """Serve the folder behind tokens."""
    made: list[RecordingPages] = []

    def with_pages(robot, desk, access, static):
        pages = RecordingPages(RecordingFolder(folder), access)
        made.append(pages)
        return PageServer(robot, desk, access, static, pages.routes)

    from robotctl.web.server import PageServer

    monkeypatch.setattr("tests.web.conftest.PageServer", with_pages)
    with Served(static, tokens=TOKENS) as served:
        yield Asked(served)


def test_the_list_has_names_sizes_and_times_as_the_files_have(served_folder, folder):
    status, _, body = served_folder.get("/recordings")
    files = {each["name"]: each for each in msgspec.msgpack.decode(body)["files"]}
    assert status == 200
    assert set(files) == {
        "robot-0001.mcap",
        "robot-0002.mcap",
        "control-0001.rec",
        "fault-20260101T000000.000Z.rec",
    }
    for name in ("robot-0001.mcap", "robot-0002.mcap"):
        with (folder / name).open("rb") as file:
            statistics = make_reader(file).get_summary().statistics
        assert files[name]["size"] == (folder / name).stat().st_size
        assert files[name]["begin_s"] == pytest.approx(
            statistics.message_start_time / 1e9, abs=0.1, rel=0
        )
        assert files[name]["end_s"] == pytest.approx(
            statistics.message_end_time / 1e9, abs=1e-3, rel=0
        )
        assert not files[name]["is_written"]
    assert files["robot-0002.mcap"]["end_s"] == pytest.approx(
        (EPOCH_NS + 4e9 - PERIOD_NS) / 1e9, abs=1e-3, rel=0
    )
    assert files["control-0001.rec"]["begin_s"] is None


def test_a_file_that_is_being_written_is_said_to_be(folder):
    path = folder / "robot-0003.mcap"
    with path.open("wb") as file:
        assert hold(file)
        file.write(b"\x89MCAP0\r\n")
        file.flush()
        (found,) = (each for each in RecordingFolder(folder).list() if each.name == path.name)
        assert found.is_written
        assert (found.size, found.begin_s) == (8, None)


@pytest.mark.parametrize("role", list(Role))
def test_whoever_may_look_may_download_and_gets_every_byte(served_folder, folder, role):
    for name in ("control-0001.rec", "robot-0001.mcap"):
        status, headers, body = served_folder.get(f"/recordings/{name}", role)
        assert status == 200
        assert body == (folder / name).read_bytes()
        assert headers["content-disposition"] == f'attachment; filename="{name}"'
        assert headers["content-length"] == str(len(body))
        assert headers["x-content-type-options"] == "nosniff"


def test_without_a_token_or_under_a_foreign_name_there_is_nothing(served_folder):
    for path in ("/recordings", "/recordings/robot-0001.mcap"):
        assert served_folder.get(path, None)[0] == 403
        assert served_folder.get(path, Host="elsewhere.example")[0] == 403


@pytest.mark.parametrize(
    "name",
    [
        "passwords.txt",
        "robot-0009.mcap.part",
        "robot-0008.mcap",  # a link to a file outside
        "robot-0007.mcap",  # a fifo, which nobody may wait for
        "robot-0042.mcap",
        "pictures-0001",
        "",
        ".",
        "..",
        "../outside",
        "..%2foutside",
        "%2e%2e%2foutside",
        "..%5coutside",
        "%2fetc%2fpasswd",
        "/etc/passwd",
        "robot-0001.mcap%00",
        "robot-0001.mcap/../passwords.txt",
        "fault-..%2foutside.rec",
        "robot-0001.mcap%0d%0aX-Evil:1",
    ],
)
def test_no_name_leads_to_anything_else(served_folder, name):
    status, headers, body = served_folder.get(f"/recordings/{name}")
    assert status == (307 if name == "" else 404)  # to the list
    assert b"secret" not in body
    assert b"root:" not in body
    assert "x-evil" not in headers


def test_a_file_that_grows_during_a_download_is_as_long_as_was_said(served_folder, folder):
    path = folder / "can-0001.log"
    path.write_bytes(b"x" * 8_000_000)
    before = path.stat().st_size
    grows = threading.Event()

    def grow() -> None:
        with path.open("ab") as file:
            while not grows.is_set():
                file.write(b"y" * 1000)
                file.flush()

    writer = threading.Thread(target=grow)
    writer.start()
    try:
        status, headers, body = served_folder.get(f"/recordings/{path.name}")
    finally:
        grows.set()
        writer.join()
    assert status == 200
    assert len(body) == int(headers["content-length"]) >= before
    assert body[:before] == b"x" * before


def test_a_robot_without_a_folder_lists_nothing(static, monkeypatch):
    pages = RecordingPages(None, Access({}, (), 1))
    assert [route.path for route in pages.routes] == ["/recordings", "/recordings/{name}"]
    assert RecordingFolder(static / "missing").list() == ()


# Start and stop


def desk_with(state: RecorderState | None, *, may_drive: bool = True) -> Desk:
    desk = Desk(has_localiser=False, arm_timeout_ns=1)
    desk.join(1, "connection", may_drive=may_drive)
    if may_drive:
        desk.name(1, "client 1")
    if state is not None:
        desk.hear(state, NOW)
    return desk


def recorder(folder: str = "/logs", stamp_ns: int = NOW.robot_ns) -> RecorderState:
    return RecorderState(stamp_ns, folder, is_recording=True, trouble="")


@pytest.mark.parametrize("on", [True, False])
def test_who_may_drive_starts_and_stops_the_recording(on):
    desk = desk_with(recorder())
    desk.take_message(1, RecordRequest(7, AT_MS, on), NOW)
    out = desk.take()
    assert out.to_recorder == [SetRecording(NOW.robot_ns, on)]
    assert not out.answers


@pytest.mark.parametrize(
    ("desk", "at_ms", "why"),
    [
        (desk_with(recorder(), may_drive=False), AT_MS, "look only"),
        (desk_with(None), AT_MS, "the recorder is silent"),
        (desk_with(recorder(stamp_ns=NOW.robot_ns - 6000 * MS)), AT_MS, "the recorder is silent"),
        (desk_with(recorder(folder="")), AT_MS, "--record FOLDER"),
        (desk_with(recorder()), AT_MS - 5000, "5.0 s late"),
    ],
)
def test_else_it_is_refused_with_the_reason(desk, at_ms, why):
    desk.take_message(1, RecordRequest(7, at_ms, False), NOW)
    out = desk.take()
    assert out.to_recorder == []
    ((answer),) = [each.message for each in out.answers]
    assert isinstance(answer, Refused)
    assert answer.id == 7
    assert why in answer.reason
