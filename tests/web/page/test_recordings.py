"""The panel of recordings: start, stop, list and download."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotctl.messages.recording import RecorderState, SetRecording
from robotctl.web.access import Role
from tests.web.page.served_robot import ServedRobot, wait_for
from tests.workbench.view.recorded import write_run

pytestmark = pytest.mark.browser
RECORDER = RecorderState(0, "/logs", is_recording=True, trouble="", free_bytes=12_300_000_000)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = write_run(tmp_path_factory.mktemp("run") / "logs", 90, files=1)
    (folder / "control-0001.rec").write_bytes(b"control")
    return folder


@pytest.fixture
def robot(folder):
    robot = ServedRobot()
    robot.stop()
    robot.recordings = folder
    robot.recorder = RECORDER
    robot.start()
    yield robot
    robot.stop()


def open_panel(open_page, **settings):
    page = open_page(**settings)
    page.get_by_role("tab", name="Record").click()
    return page


def test_it_starts_and_stops_and_says_what_is_left_of_the_disk(robot, open_page):
    page = open_panel(open_page)
    status = page.locator(".recordings [role=status]")
    wait_for(lambda: status.inner_text() == "It records. 12.3 GB left on its disk.", page)
    page.get_by_role("button", name="Stop recording").click()
    wait_for(lambda: "does not record" in status.inner_text(), page)
    page.get_by_role("button", name="Start recording").press("Enter")
    wait_for(lambda: "It records." in status.inner_text(), page)
    assert [each.on for each in robot.requests(SetRecording)] == [False, True]


def test_a_full_disk_and_a_missing_folder_are_said(robot, open_page):
    said = "logging stopped: /logs: No space left on device"
    robot.recorder = RecorderState(0, "/logs", is_recording=True, trouble=said, free_bytes=0)
    page = open_panel(open_page)
    page.get_by_role("alert").filter(has_text=said).wait_for()
    page.get_by_text("It should record, but cannot. 0 B left on its disk.").wait_for()
    robot.recorder = RecorderState(0, "", is_recording=False, trouble="", free_bytes=None)
    page.get_by_text("start it with --record FOLDER").wait_for()


@pytest.mark.parametrize("width", [1280, 390])
def test_a_recording_is_downloaded_by_its_name(robot, folder, open_page, width):
    page = open_panel(open_page, viewport={"width": width, "height": 844})
    row = page.get_by_role("row").filter(has_text="robot-0001.mcap")
    row.wait_for()
    assert "1:30.0" in row.inner_text() or "1:29.9" in row.inner_text()
    with page.expect_download() as download:
        row.get_by_role("link").click()
    assert download.value.suggested_filename == "robot-0001.mcap"
    assert Path(download.value.path()).read_bytes() == (folder / "robot-0001.mcap").read_bytes()
    page.get_by_text("1 other file").click()
    page.get_by_role("link", name="control-0001.rec").wait_for()


def test_who_may_look_only_may_download_but_not_start(folder, open_page, robot):
    tokens = {Role.LOOK: "l" * 43, Role.DRIVE: "d" * 43}
    watched = ServedRobot(tokens)
    watched.stop()
    watched.recordings, watched.recorder = folder, RECORDER
    watched.start()
    try:
        page = open_panel(open_page, url=f"{watched.url}#token={tokens[Role.LOOK]}")
        page.get_by_role("link", name="robot-0001.mcap").wait_for()
        assert page.get_by_role("button", name="Stop recording").is_disabled()
    finally:
        watched.stop()
