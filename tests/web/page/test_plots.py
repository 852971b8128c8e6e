"""Plots of fields by name."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest

from tests.web.page.served_robot import wait_for

pytestmark = pytest.mark.browser


def test_any_field_is_found_plotted_and_saved_with_its_values(robot, open_page):
    page = open_page()
    page.get_by_role("tab", name="Plots").click()
    page.get_by_role("searchbox").fill("duty")
    page.get_by_role("button", name="Add ControlState.duty[1]").click()
    page.get_by_role("button", name="Remove ControlState.v_ref_m_s").click()
    page.get_by_role("searchbox").fill("covariance[3]")
    page.get_by_role("button", name="Add LocalisationState.covariance[3]").click()
    page.wait_for_timeout(1500)  # of recording
    with page.expect_download() as download:
        page.get_by_role("button", name="Save as CSV").click()
    with Path(download.value.path()).open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert set(rows[0]) == {
        "robot_s",
        "ControlState.v_m_s",
        "ControlState.duty[1]",
        "LocalisationState.covariance[3]",
    }
    late = [row for row in rows[len(rows) // 2 :] if all(row.values())]  # the last may be half
    assert len(late) >= 10
    for row in late:
        wanted = 0.5 * math.sin(float(row["robot_s"]))
        assert float(row["ControlState.v_m_s"]) == pytest.approx(wanted, abs=1e-5)
        assert float(row["ControlState.duty[1]"]) == 0.2
        assert float(row["LocalisationState.covariance[3]"]) == 0.04


def test_a_paused_plot_stands_still_and_goes_on_live(robot, open_page):
    page = open_page()
    page.get_by_role("tab", name="Plots").click()
    canvas = page.locator(".chart canvas")
    picture = lambda: canvas.evaluate("canvas => canvas.toDataURL()")  # noqa: E731
    before = picture()
    wait_for(lambda: picture() != before, page)
    page.get_by_role("button", name="Pause").click()
    paused = picture()
    page.wait_for_timeout(400)
    assert picture() == paused
    page.get_by_role("button", name="Live").click()
    wait_for(lambda: picture() != paused, page)
