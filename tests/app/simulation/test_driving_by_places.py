"""`robotctl sim --topological`: to a place by recognising places, without a map or coordinates."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from robotctl.maps.localisation_map import load_localisation_map
from robotctl.maps.topology_file import save_topology
from robotctl.planning.map.topological.build import build
from robotctl.planning.map.topological.graph import TopologicalMap
from tests.cli.command import status_of


@pytest.fixture
def places(tmp_path: Path) -> Path:
    """The places of the flat: a lounge in the west, a kitchen in the east; no coordinates."""
    found = build(load_localisation_map("flat", Path()).grid, 0.2).map
    east, west = sorted(found.places, key=lambda place: -place.x_m)
    named = found.renamed(east.name, "kitchen").renamed(west.name, "lounge")
    bare = TopologicalMap(
        tuple(replace(each, x_m=math.nan, y_m=math.nan) for each in named.places),
        tuple(replace(each, x_m=math.nan, y_m=math.nan) for each in named.passages),
    )
    file = tmp_path / "places.toml"
    save_topology(bare, file)
    return file


def test_it_drives_to_the_next_room_and_knows_when_it_is_there(
    places: Path, tmp_path: Path
) -> None:
    report = tmp_path / "score.json"
    status = status_of(
        "sim", "--lockstep", "--topological", str(places), "--goal", "kitchen",
        "--start", "3.5,3.5,100", "--set", "simulation.errors.track_width=0.03",
        "--max-seconds", "60", "--report", str(report),
    )  # fmt: skip
    assert status == 0
    score = json.loads(report.read_text(encoding="utf-8"))
    assert score["arrived"]
    assert score["collisions"] == 0
    assert score["distance_m"] < 8.0


def test_a_place_that_is_not_known_is_refused_with_the_nearest(
    places: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "sim", "--lockstep", "--topological", str(places), "--goal", "kitchn"
    assert status_of(*words) == 2
    assert "place: no place 'kitchn'; did you mean \"kitchen\"?" in capsys.readouterr().err


def test_a_robot_without_places_refuses_to_go_to_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission = tmp_path / "mission.toml"
    mission.write_text(
        'name = "m"\nworld = "flat"\nstart = { x_m = 1.0, y_m = 1.0 }\n'
        '[[item]]\nkind = "goto_place"\nplace = "kitchen"\n',
        encoding="utf-8",
    )
    assert status_of("sim", "--lockstep", "--mission", str(mission)) == 2
    assert "navigation.pilot.topology names no map of them" in capsys.readouterr().err
    assert status_of("sim", "--lockstep", "--goal", "kitchen") == 2
    assert "a place by name needs --topological FILE" in capsys.readouterr().err
