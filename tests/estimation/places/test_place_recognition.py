"""The benchmark of place recognition in the simulated office, short."""

import numpy as np

from benchmarks import place_recognition
from benchmarks.place_recognition import MARKS, Outcome, Room, trial
from robotctl.config.robot_file import find_file
from robotctl.workbench.places.places import marked


def test_five_places_of_the_office_are_recognised_turned_and_others_refused(monkeypatch):
    monkeypatch.setattr(place_recognition, "VISITS", 4)
    room = Room("office", np.random.default_rng(11))
    places = [marked(find_file("office", "worlds"), name) for name in MARKS]
    outcome = Outcome()
    trial(room, places, room.turned, outcome)
    assert outcome.confusion.sum() == 40
    assert outcome.right >= 0.95
    assert outcome.refused >= 0.95
    off, sigma = np.abs(np.array(outcome.turned_rad)).T
    assert np.mean(off < 2.0 * sigma) >= 0.9
    assert np.degrees(sigma).max() < 6.0
    assert 0.1 < np.mean(outcome.position_nees) < 2.0
    assert np.mean(outcome.ruled_out) > 0.04
