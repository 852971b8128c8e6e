"""Graph files: what is written is read again, and errors say file, line and what is allowed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.errors import ConfigError
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor_graph import chi2_of
from robotctl.estimation.slam.graph.variables import POINT2, SE2, SE3
from robotctl.logs.graphs.graph_files import GRAPH_FORMATS, format_of, read_graph
from robotctl.logs.graphs.graph_format import GraphFile, GraphFormatError

FACTORS_OF = {
    "g2o": (
        ("between_2d", "seen_2d", "bearing", "prior_2d", "position_2d", "prior_point_2d"),
        ("between_3d", "seen_3d", "prior_3d"),
    ),
    "GTSAM's text": (("between_2d", "seen_2d"),),
    "TORO": (("between_2d",), ("between_3d",)),
}


def random_file(names, rng):
    builder = GraphBuilder()
    kinds = {kind for name in names for kind in FACTORS[name].variables}
    for kind in kinds:
        ids = np.arange(6) if kind.is_pose else np.arange(101, 104)
        values = rng.normal(0.0, 2.0, (len(ids), kind.size))
        if kind is SE3:
            values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
        builder.variables(kind, ids, values)
    for name in names:
        kind = FACTORS[name]
        first = [slot if v.is_pose else 100 for slot, v in enumerate(kind.variables)]
        ids = np.array([[3], [1], [2]]) + first
        z = rng.normal(0.0, 1.0, (3, kind.measurement))
        if kind.measurement == SE3.size:
            z[:, 3:] /= np.linalg.norm(z[:, 3:], axis=1, keepdims=True)
        half = rng.normal(0.0, 1.0, (3, kind.size, kind.size))
        builder.factors(kind, ids, z, half @ half.transpose(0, 2, 1) + np.eye(kind.size))
    graph, values, known = builder.build()
    return GraphFile(graph, values, known, np.array([1]) if SE2 in kinds else np.array([], int))


@pytest.mark.parametrize("each", GRAPH_FORMATS, ids=lambda each: each.name)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_a_graph_that_was_written_is_read_again(each, seed, tmp_path_factory):
    path = tmp_path_factory.mktemp("graphs") / f"a{each.suffix}"
    for names in FACTORS_OF[each.name]:
        wanted = random_file(names, np.random.default_rng(seed))
        each.write(path, wanted)
        found = read_graph(path)
        assert [k.name for k in found.graph.ids] == [k.name for k in wanted.graph.ids]
        if each.name == "GTSAM's text":  # no word for a point
            found.values.update({POINT2: wanted.values[POINT2]})
        assert chi2_of(found.graph, found.values) == pytest.approx(
            chi2_of(wanted.graph, wanted.values), rel=1e-9
        )
        for kind, ids in wanted.graph.ids.items():
            np.testing.assert_array_equal(found.graph.ids[kind], ids)
        if each.name == "g2o":
            np.testing.assert_array_equal(found.fixed, wanted.fixed)


def test_bearing_and_range_of_gtsam_go_round(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("ODOMETRY 0 1 1 0 0.1 0.01 0 0 0.01 0 0.001\nBR 1 1 0.5 3 0.01 0.1\n")
    file = read_graph(path)
    assert [file.graph.name(k) for k in range(3)] == ["pose 0", "pose 1", "point 1"]
    format_of(path).write(path, file)
    again = read_graph(path)
    np.testing.assert_allclose(again.graph.blocks[1].measurements, [[3.0, 0.5]])
    np.testing.assert_allclose(again.graph.blocks[1].information, [np.diag([1e2, 1e4])])


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0", r":2: EDGE_SE2: found 10 words, needed are 11: id 1"),
        ("EDGE_SE2 0 1 1 0 x 1 0 0 1 0 1", r":2: EDGE_SE2: theta 'x': a finite number is needed"),
        ("EDGE_SE2 0 1 1 0 nan 1 0 0 1 0 1", r":2: EDGE_SE2: theta 'nan'"),
        ("EDGE_SE2 0 1.5 1 0 0 1 0 0 1 0 1", r":2: EDGE_SE2: id '1.5': a whole number"),
        ("EDGE_SE2 1 1 1 0 0 1 0 0 1 0 1", r":2: links a variable with itself"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 -1", r":2: the information matrix is not positive"),
        ("EDGE_SE3 0 1 1 0 0 1 0 0 1 0 1", r":2: 'EDGE_SE3': unknown; did you mean \"EDGE_SE2\""),
        ("VERTEX_SE2 0 1 1 0", r":2: pose 0 is there already"),
        ("FIX 7", r":2: 7 is to be fixed: there is no such variable"),
    ],
)  # fmt: skip
def test_a_wrong_line_is_named(tmp_path, line, problem):
    path = tmp_path / "a.g2o"
    path.write_text(f"VERTEX_SE2 0 0 0 0\n{line}\n")
    with pytest.raises(GraphFormatError, match=problem):
        read_graph(path)


def test_wrong_files_and_suffixes_are_named(tmp_path):
    (tmp_path / "intel.g2o").write_text("hello\n")
    with pytest.raises(ConfigError, match="is no graph of a known format"):
        read_graph(tmp_path / "intel.g2o")
    with pytest.raises(ConfigError, match=r'no such file; did you mean "intel.g2o"'):
        read_graph(tmp_path / "intell.g2o")
    with pytest.raises(ConfigError, match=r"\.g2o \(g2o\)"):
        format_of(tmp_path / "a.csv")


def test_what_a_format_has_no_word_for_is_named(tmp_path):
    file = random_file(("between_3d",), np.random.default_rng(0))
    with pytest.raises(GraphFormatError, match="has no poses in space"):
        format_of(tmp_path / "a.txt").write(tmp_path / "a.txt", file)
    file = random_file(("between_2d", "range"), np.random.default_rng(0))
    with pytest.raises(GraphFormatError, match="g2o has no factors 'range'"):
        format_of(tmp_path / "a.g2o").write(tmp_path / "a.g2o", file)
