"""A rival has to explain the measurements better, while it moves, for long enough."""

import numpy as np
import pytest

from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.particle_belief import ParticleBelief
from robotctl.estimation.mcl.rival import Rival, RivalVerdict

CONFIG = MclConfig()
HERE = ParticleBelief(CONFIG, np.zeros((10, 3)), searching=False).best


def rival(x_m: float = 5.0, *, agreed: int = 20) -> Rival:
    belief = ParticleBelief(CONFIG, np.tile([x_m, 0.0, 0.0], (10, 1)), searching=True)
    belief.agreed = agreed
    return Rival(belief)


def verdicts(it: Rival, leads: list[float], step_m: float = 0.2, turn_rad: float = 0.0):
    return [it.compare(lead, step_m, turn_rad, HERE) for lead in leads]


@pytest.mark.parametrize(("step_m", "turn_rad"), [(0.2, 0.0), (0.0, 0.2)])
def test_a_place_that_foretells_better_on_the_way_is_proven(step_m, turn_rad):
    found = verdicts(rival(), [4.0] * 6, step_m, turn_rad)
    assert found[:3] == [RivalVerdict.OPEN] * 3
    assert RivalVerdict.PROVEN in found


@pytest.mark.parametrize("lead", [4.0, 1000.0, np.inf])
def test_a_robot_that_stands_still_proves_nothing(lead):
    assert set(verdicts(rival(), [lead] * 50, step_m=0.0)) == {RivalVerdict.OPEN}


def test_one_scan_however_telling_proves_nothing():
    leads = [0.0, 0.0, 1e6, -1.0, -1.0, 0.0, 0.0, 0.0]
    assert set(verdicts(rival(), leads)) == {RivalVerdict.OPEN}


def test_a_search_that_has_not_settled_proves_nothing():
    assert set(verdicts(rival(agreed=0), [9.0] * 50)) == {RivalVerdict.OPEN}
    assert set(verdicts(rival(agreed=3), [9.0] * 50)) == {RivalVerdict.OPEN}


def test_what_led_before_the_search_settled_does_not_count():
    it = rival(agreed=0)
    verdicts(it, [9.0] * 20)
    it.belief.agreed = 20
    assert set(verdicts(it, [0.5] * 10)) == {RivalVerdict.OPEN}


@pytest.mark.parametrize("agreed", [0, 20])
def test_a_place_that_foretells_worse_is_refuted(agreed):
    assert RivalVerdict.REFUTED in verdicts(rival(agreed=agreed), [-4.0] * 6)


def test_the_tracked_place_itself_is_no_rival():
    assert RivalVerdict.REFUTED in verdicts(rival(0.1), [9.0] * 6)
