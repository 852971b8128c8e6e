"""The simulated robot looks while it drives, under the virtual clock."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from mcap.reader import make_reader

from robotctl.app.simulation.simulator_files import SimulatorError
from robotctl.config.robot_file import find_file
from robotctl.logs.formats.image_folder import timed_images
from tests.app.simulation.missions import drive, fingerprint, without_computing_times

LOOKS = ("camera.enabled=true",)
MCL = ('localisation.method="mcl"', 'localisation.sensors=["camera"]')


@pytest.fixture(scope="module")
def seeing():
    """Report of a drive by the camera alone: neither lidar nor sonars are listened to."""
    return drive(overrides=LOOKS, localisation=MCL, max_seconds=20)


def test_ranges_that_the_camera_sees_are_right_and_know_how_sure_they_are(seeing):
    camera = seeing.camera
    assert 180 < camera.pictures <= 10 * seeing.duration_s + 1
    assert camera.untrusted <= 0.02 * camera.pictures
    assert camera.range_error < 0.02
    assert camera.within_3_sigma > 0.95


def test_the_camera_alone_tells_the_robot_where_it_is(seeing):
    place = seeing.localisation
    assert place.localised_share > 0.95
    assert place.wrong_s == 0.0
    assert place.error.max_m < 0.25
    assert place.nees_inside_95 > 0.8


def test_the_same_seed_sees_the_same():
    first, second = (
        without_computing_times(drive(overrides=LOOKS, max_seconds=3)) for _ in range(2)
    )
    assert first["camera"].pop("step_ms") > 0.0
    assert second["camera"].pop("step_ms") > 0.0
    assert first == second
    assert first["camera"]["pictures"] > 20


@pytest.fixture(scope="module")
def cup_in_the_way(tmp_path_factory):
    """The flat, with a cup on the first side of the patrol's square."""
    text = find_file("flat", "worlds").read_text(encoding="utf-8")
    path = tmp_path_factory.mktemp("world") / "flat.toml"
    cup = '[[obstacle]]\nname = "cup"\ncentre = [2.6, 1.02]\nradius_m = 0.04\nheight_m = 0.09\n'
    path.write_text(text + cup, encoding="utf-8")
    return path


def test_a_robot_that_looks_stops_before_a_thing_that_its_sonars_do_not_hear(cup_in_the_way):
    report = drive(overrides=LOOKS, world=str(cup_in_the_way), max_seconds=25)
    assert report.collisions == 0
    assert not report.mission_completed
    assert "something lies on the floor" in report.message
    assert 0.9 < report.distance_m < 1.4
    assert report.camera.found > 0
    assert report.camera.false == 0


def test_without_its_camera_it_drives_into_that(cup_in_the_way):
    assert drive(world=str(cup_in_the_way), max_seconds=10).collisions > 0


def test_a_lens_that_the_simulator_cannot_draw_is_told_as_an_error_of_the_run(tmp_path):
    text = find_file("diff_drive").read_text(encoding="utf-8")
    folded = re.sub(r"(?m)^distortion = .*$", "distortion = [-0.9, 0.0, 0.0, 0.0, 0.0]", text)
    path = tmp_path / "folded.toml"
    path.write_text(folded, encoding="utf-8")
    with pytest.raises(SimulatorError, match="diff_drive: camera: distortion: folds the picture"):
        drive(str(path), overrides=LOOKS, max_seconds=1)


def test_a_recorded_run_keeps_the_pictures_that_the_robot_saw(tmp_path):
    keeps = (*LOOKS, "log.pictures_every_s=0.5")
    for _ in range(2):
        drive(overrides=keeps, max_seconds=2, record=tmp_path)
    first, second = (tmp_path / f"pictures-000{number}" for number in (1, 2))
    stamps_ns = [each.stamp_ns for each in timed_images(first)]
    assert np.diff(stamps_ns) == pytest.approx(0.5e9, abs=0.06e9)
    with (tmp_path / "robot-0001.mcap").open("rb") as file:
        views = [json.loads(each.data) for _, _, each in make_reader(file).iter_messages("camera")]
    assert set(stamps_ns[:-1]) <= {each["stamp_ns"] for each in views}
    assert fingerprint(first) == fingerprint(second)
