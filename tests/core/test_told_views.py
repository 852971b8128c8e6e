"""What navigation tells of its mission and bounds, and the zones that are drawn while it runs."""

from __future__ import annotations

import zlib

import msgspec
import pytest

from robotctl.app.processes.navigator import make_navigation
from robotctl.app.processes.plan_files import PlanFiles, load_bounds
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.core.told_views import ToldViews
from robotctl.errors import DiskError
from robotctl.messages.fence import SetFence, SetRally
from robotctl.messages.plans import BoundsView, DrawnZone, MissionView, SetZones, ZonesFile
from robotctl.model.fence import Fence, FencePolygon

S = 1_000_000_000
SQUARE = ((2.0, 0.5), (3.0, 0.5), (3.0, 1.5), (2.0, 1.5))
ZONES = (DrawnZone("stairs", SQUARE), DrawnZone("kitchen", SQUARE, 0.2))
MISSION = """
name = "rounds"
start = { x_m = 1.0, y_m = 2.0, heading_deg = 0.0 }
[[zone]]
name = "own"
corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
[[item]]
kind = "wait"
duration_s = 1.0
"""


def views(adapter, now_ns):
    """Return what is told, by its type."""
    return {type(each): each for each in adapter.views(now_ns)}


def navigation(tmp_path, *settings):
    file = tmp_path / "rounds.toml"
    file.write_text(MISSION)
    config = load_robot(find_file("diff_drive"), settings)
    options = StackOptions("x", "", mission=str(file), x_m=1.0, y_m=2.0)
    return config, options, make_navigation(config, options)


def test_mission_fence_rally_points_and_home_are_told(tmp_path):
    _, _, adapter = navigation(tmp_path)
    fence = Fence((FencePolygon(SQUARE, True),))
    adapter.bound_by([SetFence(0, fence, 5), SetRally(0, ((4.0, 4.0),), 6)])
    told = views(adapter, 1)
    assert told[MissionView].content == MISSION.encode()
    bounds = told[BoundsView]
    assert (bounds.fence, bounds.fence_crc, bounds.fence_enabled) == (fence, 5, True)
    assert (bounds.rally, bounds.rally_crc) == (((4.0, 4.0),), 6)
    assert bounds.home == (1.0, 2.0, 0.0)
    assert [(each.name, each.origin) for each in bounds.zones] == [("own", "mission")]


def test_what_does_not_change_is_told_every_two_seconds_and_what_does_at_once():
    told = ToldViews()
    view = MissionView(0, "", 1, b"x")

    def due(now_ns, **changes):
        return told.due(msgspec.structs.replace(view, stamp_ns=now_ns, **changes))

    assert due(0)
    assert not due(S)
    assert due(S + 1, crc=2)
    assert not due(2 * S, crc=2)
    assert due(3 * S + 1, crc=2)


def test_a_robot_that_plans_nothing_takes_no_zones_and_says_so(tmp_path):
    _, _, adapter = navigation(tmp_path)
    adapter.bound_by([SetZones(0, ZONES, 7)])
    assert "neither a map nor a lidar" in " ".join(adapter.take_notices())
    assert views(adapter, 1)[BoundsView].zones_crc == 0


def test_zones_that_are_drawn_while_it_runs_close_the_map_and_open_it_again(tmp_path):
    _, _, adapter = navigation(tmp_path)
    adapter.navigator.take_pilot(pilot := Pilot())
    adapter.bound_by([SetZones(0, ZONES, 7)])
    assert [(each.name, each.speed_m_s) for each in pilot.drawn] == [
        ("stairs", 0),
        ("kitchen", 0.2),
    ]
    bounds = views(adapter, 1)[BoundsView]
    assert bounds.zones_crc == 7
    assert [each.name for each in bounds.zones] == ["own", "stairs", "kitchen"]
    adapter.bound_by([SetZones(0, (), 0)])
    assert pilot.drawn == []
    bad = (DrawnZone("bad", SQUARE[:2]),)
    adapter.bound_by([SetZones(0, bad, 8)])
    assert "zones refused: corners: 2 found" in " ".join(adapter.take_notices())


class Pilot:
    """Takes bounds."""

    def use_drawn_zones(self, zones):
        self.drawn = list(zones)

    def use_zones(self, zones):
        """Take those of a mission."""

    def outlook(self):
        """Return that there is nothing to see."""

    use_fence = use_recovery = use_zones


def test_drawn_zones_outlive_a_restart_and_a_damaged_file_is_said(tmp_path):
    content = msgspec.json.encode(ZonesFile(ZONES))
    files = PlanFiles(str(tmp_path), "zones")
    files.save(content)
    files.keep(content)
    assert load_bounds(str(tmp_path), "zones") == (SetZones(0, ZONES, zlib.crc32(content)),)
    files.keep(b"")
    assert load_bounds(str(tmp_path), "zones") == ()
    files.save(b"{")
    with pytest.raises(DiskError, match="zones cannot be read"):
        load_bounds(str(tmp_path), "zones")
