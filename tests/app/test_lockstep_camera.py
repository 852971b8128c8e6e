"""The simulated robot looks while it drives, under the virtual clock."""

from __future__ import annotations

import pytest

from tests.app.missions import drive, without_computing_times

LOOKS = ("camera.enabled=true",)
MCL = ('localisation.method="mcl"', 'localisation.sensors=["camera"]')


@pytest.fixture(scope="module")
def seeing():
    """Report of a drive by the camera alone: neither lidar nor sonars are listened to."""
    return drive(overrides=LOOKS, localisation=MCL, max_seconds=30)


def test_ranges_that_the_camera_sees_are_right_and_know_how_sure_they_are(seeing):
    camera = seeing.camera
    assert 250 < camera.pictures <= 300
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
