"""A robot that turns on the spot while it drives about recognises where it is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from robotctl.app.localisation.estimators import make_estimators
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.places.options import PlaceSource
from robotctl.workbench.places.places import learn
from tests.workbench.places.test_places import Shifted, write_log
from tests.workbench.places.turning_robot import ROBOT, hallway, kitchen, turning

WORLD = """
[world]
name = "room"
start = { x_m = 1.0, y_m = 1.0 }
[[wall]]
points = [[0.0, 0.0], [12.0, 0.0], [12.0, 9.0], [0.0, 9.0]]
closed = true
"""
AT = (8.0, 6.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A world, and a book with the kitchen learnt at `AT`."""
    folder = tmp_path_factory.mktemp("places")
    (folder / "room.toml").write_text(WORLD)
    log = write_log(folder / "kitchen", turning(kitchen), Shifted(*AT))
    learn("kitchen", folder / "book.toml", PlaceSource(log=log), lambda _turned: None)
    return folder


def estimators(folder, *settings):
    """A robot that goes by places alone and has no idea where it is."""
    config = load_robot(
        find_file("diff_drive"),
        (
            'localisation.method="mcl"',
            'localisation.start="unknown"',
            "localisation.sensors=[]",
            'localisation.map="room.toml"',
            'localisation.places="book.toml"',
            *settings,
        ),
    )
    return make_estimators(replace(config, sonar=ROBOT.sonar), SE2(), folder)


def after(several, states):
    """Return what was told, the particles after some states, and what is believed then."""
    news, believed = [], None
    for state in states:
        believed = several.step(state, (), (), state.stamp_ns)
        news += several.take_notices()
    return news, several.localiser.particles, believed


def test_particles_that_may_be_anywhere_gather_at_the_place_that_is_recognised(folder):
    news, particles, believed = after(estimators(folder), turning(kitchen, heading=0.4))
    assert "the place kitchen is recognised by its sonars" in news
    off = np.hypot(*(particles[:, :2] - AT).T)
    assert np.mean(off < 0.5) > 0.8
    # The odometry began at the origin and looks as the world does.
    assert (believed.x_m, believed.y_m) == pytest.approx(AT, abs=0.15)
    assert believed.theta_rad == pytest.approx(0.0, abs=0.1)


def test_a_place_that_is_not_known_leaves_the_particles_where_they_are_and_is_said(folder):
    news, particles, _ = after(estimators(folder), turning(hallway))
    assert any(line.startswith("no place is recognised: ") for line in news)
    assert np.ptp(particles[:, 0]) > 8.0


def test_a_book_that_is_missing_or_of_no_use_is_an_error_that_names_it(folder):
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        estimators(folder, 'localisation.places="nowhere.toml"')
    config = load_robot(
        find_file("diff_drive"),
        ('localisation.method="mcl"', 'localisation.places="book.toml"', "sonar=[]",
         'localisation.map="room.toml"'),
    )  # fmt: skip
    with pytest.raises(ConfigError, match="this robot has none"):
        make_estimators(config, SE2(), folder)
    with pytest.raises(ConfigError, match='places: needs method "mcl"'):
        load_robot(find_file("diff_drive"), ('localisation.places="book.toml"',))


def test_the_turn_of_these_tests_is_one():
    headings = np.unwrap([state.theta_rad for state in turning(kitchen)])
    assert np.ptp(headings) > math.tau
