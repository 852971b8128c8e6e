"""Open-loop experiments: when they end early."""

import pytest

from robotctl.workbench.tuning.open_loop import find_duty
from robotctl.workbench.tuning.track import ExperimentError

DT_S = 0.005


class ReversedWheels:
    dt_s = DT_S
    speed_rad_s = 0.0

    def hold(self, duty, duration_s):
        self.speed_rad_s = -20.0 * duty


def test_wheels_that_turn_backwards_end_the_experiment_at_once():
    wheels = ReversedWheels()
    with pytest.raises(ExperimentError, match="reversed"):
        find_duty(wheels, 10.0, 1.0)
    assert wheels.speed_rad_s > -3.0
