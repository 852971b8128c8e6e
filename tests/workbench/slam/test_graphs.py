"""SLAM of graph files: the filter beside the optimum of all, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from robotctl.errors import ConfigError, RobotctlError
from robotctl.estimation.slam.ekf_slam.way import way_of
from robotctl.estimation.slam.graph.variables import POINT2
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.logs.graphs.g2o import G2O
from robotctl.logs.graphs.graph_files import read_graph
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.slam.options import SlamOptions
from robotctl.workbench.slam.slam import slam, write_results


def silent(*_):
    pass


def written(folder, *, sigma_m=0.02, seed=0, tail=""):
    """A drive round a square among nine landmarks, as GTSAM's text."""
    rng = np.random.default_rng(seed)
    points = np.array([[x, y] for x in (-1.0, 2.0, 5.0) for y in (-1.5, 2.0, 5.5)])
    pose, lines = SE2(), []
    for k in range(81):
        if k:
            delta = SE2(0.2, 0.0, np.pi / 2 if k % 20 == 0 else 0.0)
            pose = pose @ delta
            x, y, turn = np.array([0.2, 0.0, delta.theta_rad]) + rng.normal(0.0, 0.005, 3)
            lines.append(f"ODOMETRY {k - 1} {k} {x} {y} {turn} 2.5e-5 0 0 2.5e-5 0 2.5e-5")
        for number, point in enumerate(points):
            x, y = pose.inverse().apply(*point.tolist())
            if np.hypot(x, y) < 3.0:
                x, y = np.array([x, y]) + rng.normal(0.0, sigma_m, 2)
                lines.append(f"LANDMARK {k} {100 + number} {x} {y} {sigma_m**2} 0 {sigma_m**2}")
    path = folder / "square.txt"
    path.write_text("\n".join(lines) + "\n" + tail)
    return path, points


def test_filter_and_smoother_agree_on_map_and_way_and_with_the_truth(tmp_path):
    path, points = written(tmp_path)
    found = {
        solver: slam(SlamOptions(log=path, solver=solver), silent) for solver in ("ekf", "graph")
    }
    ekf, graph = found["ekf"], found["graph"]
    assert ekf.landmarks.positions == pytest.approx(graph.landmarks.positions, abs=0.01)
    assert ekf.landmarks.positions == pytest.approx(points, abs=0.1)
    assert ekf.landmarks.covariances == pytest.approx(
        graph.landmarks.covariances, rel=0.1, abs=1e-6
    )
    poses = [each.estimate.trajectory.poses for each in (ekf, graph)]
    assert poses[0][:, :2] == pytest.approx(poses[1][:, :2], abs=0.03)
    doubts = dict(zip(graph.estimate.rows.tolist(), graph.estimate.covariances, strict=True))
    for row, P in zip(ekf.estimate.rows.tolist()[1:], ekf.estimate.covariances[1:], strict=True):
        assert pytest.approx(doubts[row], rel=0.15, abs=2e-6) == P


def test_a_log_that_is_a_graph_is_smoothed_unless_the_filter_is_asked_for(tmp_path):
    path, _ = written(tmp_path)
    usual, graph, ekf = (
        slam(SlamOptions(log=path, solver=solver), silent).estimate.trajectory.poses
        for solver in ("", "graph", "ekf")
    )
    assert np.array_equal(usual, graph)
    assert not np.array_equal(usual, ekf)


def test_the_graph_that_is_written_is_read_again_at_the_same_place(tmp_path):
    path, points = written(tmp_path)
    result = slam(SlamOptions(log=path, solver="graph"), silent)
    write_results(result, tmp_path)
    again = read_graph(tmp_path / "graph.g2o")
    assert again.values[POINT2] == pytest.approx(result.landmarks.positions, abs=1e-6)
    assert again.values[POSES] == pytest.approx(result.estimate.trajectory.poses, abs=1e-6)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["landmarks"] == len(points)
    assert report["trajectory"] is None


@pytest.mark.parametrize(
    ("tail", "message"),
    [
        ("ODOMETRY 0 40 1 0 0 1 0 0 1 0 1\n", "poses 0 and 40 are linked"),
        ("ODOMETRY 81 82 1 0 0 1 0 0 1 0 1\n", "nothing leads to pose 81"),
    ],
)
def test_a_graph_that_is_no_way_is_refused(tmp_path, tail, message):
    path, _ = written(tmp_path, tail=tail)
    with pytest.raises(RobotctlError, match=message):
        slam(SlamOptions(log=path), silent)


def test_association_is_that_of_the_graph(tmp_path):
    path, _ = written(tmp_path)
    with pytest.raises(ConfigError, match="only names is possible"):
        slam(SlamOptions(log=path, association="joint"), silent)


def test_a_way_keeps_what_is_known_and_shares_the_rest_out_evenly():
    deltas = np.tile([1.0, 0.0, 0.0], (5, 1))
    found = way_of(deltas, [0, 4], [SE2(), SE2(4.0, 0.4, 0.0)])
    assert found[:, 0] == pytest.approx(np.arange(5.0))
    assert found[:, 1] == pytest.approx(0.1 * np.arange(5.0))


@pytest.mark.recordings("landmark/victoria_park.txt")
def test_victoria_park_is_driven_through_as_the_smoother_has_it(recordings):
    path = recordings / "landmark" / "victoria_park.txt"
    ekf = slam(SlamOptions(log=path), silent)
    graph = slam(SlamOptions(log=path, solver="graph"), silent)
    assert len(ekf.landmarks.names) == 151
    off = ekf.estimate.trajectory.poses[:, :2] - graph.estimate.trajectory.poses[:, :2]
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 2.0
    assert graph.figures["chi2"] == pytest.approx(6184.1, abs=0.1)


def test_a_first_pose_that_is_fixed_is_where_the_drive_begins(tmp_path):
    path, points = written(tmp_path)
    graph = tmp_path / "square.g2o"
    file = read_graph(path)
    file.values[POSES][0] = turned = np.array([3.0, -2.0, 0.7])
    G2O.write(graph, replace(file, fixed=np.array([0])))
    c, s = np.cos(turned[2]), np.sin(turned[2])
    expected = points @ np.array([[c, s], [-s, c]]) + turned[:2]
    for solver in ("ekf", "graph", "submaps"):
        found = slam(SlamOptions(log=graph, solver=solver), silent)
        assert found.estimate.trajectory.poses[0] == pytest.approx(turned, abs=1e-6)
        assert found.landmarks.positions == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("FIX 3 101", "pose 3, point 101 fixed: for the filter only the first pose is"),
        ("EDGE_SE2_XY 0 101 1 1 0 0 4", "information between pose 0, point 101 is singular"),
    ],
)
def test_what_the_filter_cannot_hold_is_named(tmp_path, line, problem):
    path, _ = written(tmp_path)
    graph = tmp_path / "square.g2o"
    file = read_graph(path)
    known = {kind: np.ones(len(ids), bool) for kind, ids in file.graph.ids.items()}
    G2O.write(graph, replace(file, known=known))
    with graph.open("a") as text:
        text.write(f"{line}\n")
    with pytest.raises(RobotctlError, match=problem):
        slam(SlamOptions(log=graph, solver="graph"), silent)
