"""The report of a localised drive against figures by hand."""

import math

import numpy as np
import pytest

from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.localise.report import Run, is_lost, report

LOCALISED, SEARCHING, LOST = (
    LocalisationStatus.LOCALISED,
    LocalisationStatus.SEARCHING,
    LocalisationStatus.LOST,
)


def run_of(*entries, **keywords):
    """A run of (estimate, reference, status), a second apart, with unit covariance."""
    run = Run(**keywords)
    for i, (estimate, reference, status) in enumerate(entries):
        pose = PoseEstimate(i * 10**9, SE2(*estimate), np.eye(3), status)
        run.add(pose, None if reference is None else SE2(*reference))
    return run


def off(x_m, status=LOCALISED):
    """An estimate that is off by so much."""
    return (x_m, 0.0, 0.0), (0.0, 0.0, 0.0), status


def test_position_errors_are_distances_without_alignment():
    run = run_of(((3.0, 4.0, 0.0), (0.0, 0.0, 0.0), LOCALISED), off(1.0), off(0.0))
    ape = report(run, with_nees=False)["ape"]
    assert ape["rmse_m"] == pytest.approx(math.sqrt(26.0 / 3.0))
    assert ape["mean_m"] == pytest.approx(2.0)
    assert ape["max_m"] == 5.0


def test_headings_are_compared_on_the_circle():
    run = run_of(((0.0, 0.0, 3.1), (0.0, 0.0, -3.1), LOCALISED))
    assert report(run, with_nees=False)["heading_rmse_rad"] == pytest.approx(math.tau - 6.2)


def test_of_a_known_start_all_errors_count():
    run = run_of(off(2.0, SEARCHING), off(0.0))
    assert report(run, with_nees=False)["ape"]["max_m"] == 2.0


def test_of_a_search_errors_count_once_the_robot_says_that_it_is_localised():
    run = run_of(off(9.0, SEARCHING), off(8.0, SEARCHING), off(0.5), off(0.1), starts_known=False)
    figures = report(run, with_nees=False)
    assert figures["ape"]["max_m"] == 0.5
    assert figures["localised_after_s"] == 2.0


def test_of_a_search_that_finds_nothing_all_errors_count_and_it_is_lost():
    run = run_of(off(9.0, SEARCHING), off(8.0, SEARCHING), starts_known=False)
    figures = report(run, with_nees=False)
    assert (figures["ape"]["max_m"], figures["lost"]) == (9.0, True)
    assert figures["localised_after_s"] is None


@pytest.mark.parametrize(
    ("end", "lost"),
    [
        ([off(0.9)] * 10, False),
        ([off(1.1)] * 10, True),
        ([off(5.0)] * 4 + [off(0.1)] * 6, False),
        ([off(0.0)] * 9 + [off(0.0, LOST)], True),
        ([off(0.0)] * 9 + [off(0.0, SEARCHING)], False),
        ([((5.0, 0.0, 0.0), None, LOCALISED)] * 10, False),
    ],
)
def test_lost_is_who_ends_far_away_or_says_so(end, lost):
    assert is_lost(run_of(*[off(0.0)] * 90, *end)) is lost


def test_without_a_reference_nothing_is_said_of_errors():
    figures = report(run_of(((1.0, 2.0, 3.0), None, LOCALISED)), with_nees=True)
    assert figures["ape"] == {"rmse_m": None, "mean_m": None, "max_m": None}
    assert figures["heading_rmse_rad"] is None
    assert figures["nees_inside_95"] is None


def test_a_reference_of_positions_alone_says_nothing_of_headings():
    run = run_of(off(1.0), has_heading=False)
    figures = report(run, with_nees=True)
    assert figures["heading_rmse_rad"] is None
    assert figures["nees_inside_95"] is None
    assert figures["ape"]["max_m"] == 1.0


def test_nees_counts_between_the_bounds_of_chi_squared_with_three_freedoms():
    """0.216 and 9.348 in the tables; with unit covariance NEES is the square of the distance."""
    inside, outside = (0.47, 1.0, 3.05), (0.46, 0.0, 3.06)
    run = run_of(*(off(x) for x in inside + outside))
    assert report(run, with_nees=True)["nees_inside_95"] == 0.5


def test_a_smoothed_run_reports_beside_it_what_the_filter_had_at_the_time():
    run = run_of(off(0.1), off(0.1))
    assert "online" not in report(run, with_nees=True)
    run.online = run_of(off(1.1), off(0.3, SEARCHING)).estimates
    figures = report(run, with_nees=True)
    assert figures["ape"]["max_m"] == pytest.approx(0.1)
    online = figures["online"]
    assert online["ape"]["max_m"] == pytest.approx(1.1)
    assert online["shares"]["confidently_wrong"] == 0.5
    assert online["nees_inside_95"] == 0.5


def test_times_and_particles_of_updates_are_summed_up():
    run = run_of(off(0.0))
    run.update_ms, run.particles = [float(i) for i in range(101)], [1000, 3000]
    figures = report(run, with_nees=False)
    assert figures["updates"] == 101
    assert figures["update_ms"] == {"p50": 50.0, "p99": 99.0}
    assert figures["particles"] == {"mean": 2000.0}
    assert "nees_inside_95" not in figures


def test_shares_are_of_the_estimates_and_the_wrong_ones_of_those_with_a_reference():
    unknown = ((0.0, 0.0, 0.0), None, LOCALISED)
    turned = ((0.0, 0.0, 0.6), (0.0, 0.0, 0.0), LOCALISED)
    run = run_of(off(0.9), off(1.1), off(5.0, SEARCHING), off(5.0, LOST), unknown, turned)
    shares = report(run, with_nees=False)["shares"]
    assert shares == pytest.approx(
        {"localised": 4 / 6, "searching": 1 / 6, "lost": 1 / 6, "confidently_wrong": 2 / 5}
    )


def test_without_a_reference_nobody_knows_what_is_wrong():
    run = run_of(((0.0, 0.0, 0.0), None, LOCALISED))
    figures = report(run, with_nees=False)
    assert figures["shares"]["confidently_wrong"] is None
    assert figures["ape"]["rmse_m"] is None
    assert figures["lost"] is False
