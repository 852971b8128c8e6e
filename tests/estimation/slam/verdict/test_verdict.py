"""The verdict on a map follows from what the run shows, and says why."""

import math

import pytest

from robotctl.estimation.slam.verdict.odometry_check import OdometryFigures
from robotctl.estimation.slam.verdict.verdict import Quality, RunFigures, verdict_of
from robotctl.estimation.slam_tuning import VerdictConfig

SOUND = OdometryFigures(200.0, 1.0, 1.0, 1.02, 0.97, 0.01)
SHIFTS_M = [0.0] * 60


def verdict(unmatched=0, shifts_m=SHIFTS_M, odometry=SOUND, breaks=0, ambiguous=0):
    return verdict_of(
        RunFigures(400, unmatched, ambiguous, shifts_m, odometry, breaks), VerdictConfig()
    )


@pytest.mark.parametrize(
    "odometry",
    [SOUND, None, OdometryFigures(3.0, 0.0, 0.0, math.nan, math.nan, math.nan)],
)
def test_a_sound_run_is_good(odometry):
    assert verdict(odometry=odometry).quality is Quality.GOOD
    assert str(verdict(odometry=odometry)) == "good"


def doubled(count):
    return SHIFTS_M[count:] + [0.8] * count


@pytest.mark.parametrize(
    ("run", "quality", "reason"),
    [
        ({"unmatched": 8}, Quality.DOUBTFUL, "8 of 400 scans match nothing near"),
        ({"unmatched": 3, "odometry": None}, Quality.DOUBTFUL, "3 of 400 scans match nothing"),
        ({"ambiguous": 20}, Quality.DOUBTFUL, "20 of 400 scans fit elsewhere nearly as well"),
        ({"breaks": 1}, Quality.DOUBTFUL, "once the way goes on where no scan agrees"),
        ({"breaks": 3}, Quality.DOUBTFUL, "at 3 places the way goes on"),
        ({"unmatched": 120}, Quality.NOT_A_MAP, "120 of 400 scans"),
        (
            {"shifts_m": doubled(5)},
            Quality.DOUBTFUL,
            "5 of 60 places passed again fit better up to 0.8",
        ),
        ({"shifts_m": doubled(30)}, Quality.NOT_A_MAP, "30 of 60 places"),
        (
            {"odometry": OdometryFigures(200.0, 14.0, 12.0, 1.0, 1.0, 0.0)},
            Quality.DOUBTFUL,
            "odometry contradicts the scans on 14 of 200 m, 12 m of them without a break",
        ),
        (
            {"odometry": OdometryFigures(200.0, 0.0, 0.0, 1.5, 1.0, 0.0)},
            Quality.DOUBTFUL,
            "distance by odometry is 1.50 times that by the scans",
        ),
        (
            {"odometry": OdometryFigures(200.0, 90.0, 5.0, 1.0, -1.0, 0.0)},
            Quality.NOT_A_MAP,
            "the beams are in reverse order",
        ),
        (
            {"odometry": OdometryFigures(200.0, 190.0, 50.0, 1.0, 1.0, -math.pi / 2.0)},
            Quality.DOUBTFUL,
            "drives 90 deg to the right of where odometry has it",
        ),
    ],
)
def test_what_is_wrong_is_told(run, quality, reason):
    found = verdict(**run)
    assert found.quality is quality
    assert reason in str(found)
    assert str(found).startswith(f"{quality} because ")


def test_one_place_that_fits_better_elsewhere_says_nothing():
    assert verdict(shifts_m=doubled(2)[50:]).quality is Quality.GOOD
