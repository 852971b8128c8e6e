"""`robotctl slam` on logs of ranges to beacons, in the format of Plaza, against the true places."""

import numpy as np
import pytest

from robotctl.errors import RobotctlError
from robotctl.logs.graphs.graph_files import read_graph
from robotctl.model.geometry.points import align, moved
from robotctl.workbench.slam.options import SlamOptions
from robotctl.workbench.slam.slam import slam, write_results

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
BEACONS = {1: (-12.0, 5.0), 4: (25.0, -8.0), 7: (14.0, 22.0), 9: (-5.0, 30.0)}
SIGMA_M = 0.1


def drive(rng, seconds=240.0, hz=5.0):
    """Return stamps [s], true poses (n + 1, 3), and what odometry says of the steps, (n, 2)."""
    n = int(seconds * hz)
    stamps = 100.0 + np.arange(n + 1) / hz
    speed = np.where(np.arange(n) < 5 * hz, 0.0, 1.0)  # it stands at first
    turn = 0.35 * np.sin(np.arange(n) / hz / 9.0) + 0.12
    turn[speed == 0.0] = 0.0
    heading = np.concatenate([[0.4], 0.4 + np.cumsum(turn / hz)])
    step = speed / hz
    x = 3.0 + np.concatenate([[0.0], np.cumsum(step * np.cos(heading[:-1]))])
    y = -2.0 + np.concatenate([[0.0], np.cumsum(step * np.sin(heading[:-1]))])
    said = np.column_stack(
        [step * (1.01 + rng.normal(0.0, 0.02, n)), turn / hz + 1e-3 + rng.normal(0.0, 1e-3, n)]
    )
    return stamps, np.column_stack([x, y, heading]), said


def write(folder, seed, *, false=0.0, surveyed=()):
    """Write a log and its truth; return the path of its odometry and the true poses."""
    rng = np.random.default_rng(seed)
    stamps, truth, said = drive(rng)
    rows = np.arange(2, len(stamps), 2)
    names = np.array(sorted(BEACONS))[rng.integers(0, len(BEACONS), len(rows))]
    places = np.array([BEACONS[each] for each in names])
    ranges = np.hypot(*(places - truth[rows, :2]).T) + rng.normal(0.0, SIGMA_M, len(rows))
    is_false = rng.random(len(rows)) < false
    ranges[is_false] = rng.uniform(0.5, 60.0, np.count_nonzero(is_false))
    lines = {
        "DR": np.column_stack([stamps[1:], said]),
        "TD": np.column_stack([stamps[rows], np.full(len(rows), 2), names, ranges]),
        "GT": np.column_stack([stamps, truth]),
    }
    if surveyed:
        lines["TL"] = np.array([(each, *BEACONS[each]) for each in surveyed])
    for end, table in lines.items():
        np.savetxt(folder / f"field_{end}.txt", table, fmt="%.10e", delimiter="\t")
    return folder / "field_DR.txt", truth


@pytest.mark.parametrize(("seed", "false"), [(0, 0.0), (1, 0.2), (2, 0.3)])
def test_drive_and_unknown_beacons_come_out_of_ranges_some_of_them_false(tmp_path, seed, false):
    log, truth = write(tmp_path, seed, false=false)
    result = slam(SlamOptions(log=log), lambda *_: None)
    own = result.estimate.trajectory.poses
    T = align(own[:, :2], truth[:, :2])
    assert np.sqrt(np.mean(np.sum((moved(T, own[:, :2]) - truth[:, :2]) ** 2, axis=1))) < 0.15
    assert result.landmarks.names == tuple(sorted(BEACONS))
    for name, place in zip(result.landmarks.names, moved(T, result.landmarks.positions), strict=True):  # fmt: skip # noqa: E501
        assert np.hypot(*(place - BEACONS[name])) < 0.3
    report = result.report()
    assert report["range_sigma_m"] == pytest.approx(SIGMA_M, rel=0.6)
    share = report["sightings"]["unused"] / sum(report["sightings"].values())
    assert share == pytest.approx(false, abs=0.07)
    assert report["trajectory"]["rmse_m"] < 0.15
    write_results(result, tmp_path)
    again = read_graph(tmp_path / "graph.g2o")
    assert again.graph.factors == result.graph.graph.factors


def test_surveyed_beacons_say_where_the_drive_is(tmp_path):
    log, truth = write(tmp_path, 3, surveyed=(1, 7, 9))
    result = slam(SlamOptions(log=log), lambda *_: None)
    own = result.estimate.trajectory.poses
    assert np.sqrt(np.mean(np.sum((own[:, :2] - truth[:, :2]) ** 2, axis=1))) < 0.15
    fourth = result.landmarks.positions[result.landmarks.names.index(4)]
    assert np.hypot(*(fourth - BEACONS[4])) < 0.3
    off = np.diff(own[[0, -1], 2]) - np.diff(truth[[0, -1], 2])
    assert np.abs(np.sin(off)) < 0.05


@pytest.mark.parametrize(
    ("end", "text", "message"),
    [
        ("TD", "1 2 3\n", "_TD.txt:1: found 3 words, needed are time, sender, beacon, range"),
        ("DR", "2 0 0\n1 0 0\n", "_DR.txt:2: time 1.0 follows 2.0"),
        ("DR", "2 0 x\n", "_DR.txt:1: found 'x', a number is needed"),
        ("TD", "100 2 1 5\n", "no beacon has 8 ranges"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, end, text, message):
    log, _ = write(tmp_path, 0)
    (tmp_path / f"field_{end}.txt").write_text(text)
    with pytest.raises(RobotctlError, match=message):
        slam(SlamOptions(log=log), lambda *_: None)
