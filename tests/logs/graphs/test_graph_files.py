"""Graph files: what is written is read again, and errors say file, line and what is allowed."""

import gzip
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.errors import ConfigError, RobotctlError
from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor_graph import chi2_of
from robotctl.estimation.slam.graph.variables import POINT2, SE2, SE3
from robotctl.logs.graphs.g2o import G2O
from robotctl.logs.graphs.graph_files import GRAPH_FORMATS, format_of, read_graph
from robotctl.logs.graphs.graph_format import GraphFile, GraphFormatError
from robotctl.logs.graphs.gtsam_text import GTSAM
from robotctl.workbench.graphs.optimise import optimise, write_graph
from robotctl.workbench.graphs.options import OptimiseOptions
from tests.logs.graphs.fuzzing import LONGEST, TARGETS, corpus, mutate, solve

FACTORS_OF = {
    "g2o": (
        ("between_2d", "seen_2d", "bearing", "range", "prior_2d", "position_2d", "prior_point_2d"),
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
        ("EDGE_SE2 0 1 1 0 1e31 1 0 0 1 0 1", r":2: EDGE_SE2: theta '1e31'.* at most 1e\+30"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1e308", r":2: EDGE_SE2: I33 '1e308'"),
        ("EDGE_PRIOR_SE2 0 inf 0 0 1 0 0 1 0 1", r":2: EDGE_PRIOR_SE2: x 'inf'"),
        ("VERTEX_SE2 1 0 -inf 0", r":2: VERTEX_SE2: y '-inf'"),
        ("VERTEX_XY 1 nan 0", r":2: VERTEX_XY: x 'nan'"),
        ("EDGE_SE2 0 1.5 1 0 0 1 0 0 1 0 1", r":2: EDGE_SE2: id '1.5': a whole number"),
        ("VERTEX_SE2 9223372036854775808 1 1 0", r":2: VERTEX_SE2: id '9223372036854775808': a"),
        ("VERTEX_XY -9223372036854775809 1 1", r":2: VERTEX_XY: id '-9223372036854775809': a"),
        ("VERTEX_XY \u00b2 1 1", r":2: VERTEX_XY: id '\u00b2': a whole number"),
        (f"VERTEX_XY {'9' * 5000} 1 1", r":2: VERTEX_XY: id '99999"),
        ("EDGE_SE2 1 1 1 0 0 1 0 0 1 0 1", r":2: links a variable with itself"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 -1", r":2: the information matrix is not positive"),
        ("EDGE_SE3 0 1 1 0 0 1 0 0 1 0 1", r":2: 'EDGE_SE3': unknown; did you mean \"EDGE_SE2\""),
        ("VERTEX_SE2 0 1 1 0", r":2: pose 0 is there already"),
        ("FIX 7", r":2: 7 is to be fixed: there is no such variable"),
        ("FIX 0 -7", r":2: -7 is to be fixed: there is no such variable"),
        ("FIX 0 x", r":2: FIX: id 'x': a whole number is needed"),
        ("FIX", r":2: FIX: found 0 ids, needed are 1"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nFIX 1", r":3: 1 is to be fixed: no line says where"),
        ("VERTEX_XY 0 1 1\nFIX 0", r":3: 0 is to be fixed: a pose and a point have this id"),
        ("VERTEX_SE3:QUAT 1 0 0 0 0 0 0 1", r"poses in the plane and in space"),
        ("EQUIV 0 1", r":2: 'EQUIV': unknown"),
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
    file = random_file(("between_2d", "range_bearing"), np.random.default_rng(0))
    with pytest.raises(GraphFormatError, match="g2o has no factors 'range and bearing'"):
        format_of(tmp_path / "a.g2o").write(tmp_path / "a.g2o", file)


SPACE = "9 0 0 0 0 0 9 0 0 0 0 9 0 0 0 4 0 0 4 0 4"


@pytest.mark.parametrize(
    "line",
    [
        "VERTEX_SE3:QUAT 1 1 2 3 0 0 0 0",
        f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 0 {SPACE}",
        f"EDGE_SE3_PRIOR 0 0 1 0 0 1e-200 0 0 0 {SPACE}",
    ],
)
def test_a_quaternion_that_is_zero_is_refused_wherever_it_stands(tmp_path, line):
    path = tmp_path / "a.g2o"
    path.write_text(f"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(GraphFormatError, match=":2: the quaternion is 0"):
        read_graph(path)


def test_a_quaternion_of_length_one_stays_as_it_is_written_and_another_gets_it(tmp_path):
    path = tmp_path / "a.g2o"
    half = 0.7071067811865476
    path.write_text(
        f"VERTEX_SE3:QUAT 0 0 0 0 0 0 {half} {half}\nVERTEX_SE3:QUAT 1 0 0 0 0 0 3 4\nFIX 0 1\n"
    )
    poses = read_graph(path).values[SE3]
    np.testing.assert_array_equal(poses[0], (0, 0, 0, 0, 0, half, half))
    np.testing.assert_allclose(poses[1], (0, 0, 0, 0, 0, 0.6, 0.8), atol=1e-15)


def test_variables_are_fixed_by_any_id_in_any_line(tmp_path):
    path = tmp_path / "a.g2o"
    path.write_text(
        "FIX -3 9223372036854775807\nVERTEX_SE2 -3 1 2 3\nVERTEX_SE2 5 1 2 3\nFIX 7 -3\n"
        "VERTEX_SE2 9223372036854775807 0 0 0\nVERTEX_XY 7 1 1\n"
    )
    file = read_graph(path)
    names = [file.graph.name(each) for each in file.fixed]
    assert names == ["pose -3", "pose 9223372036854775807", "point 7"]
    assert read_graph_again(path, file).fixed.tolist() == file.fixed.tolist()


def read_graph_again(path, file):
    format_of(path).write(path, file)
    return read_graph(path)


def test_a_pose_and_a_point_may_share_an_id_as_in_files_of_gtsam(tmp_path):
    path = tmp_path / "a.g2o"
    path.write_text(
        "VERTEX_SE2 0 0 0 0\nVERTEX_XY 0 1 1\nEDGE_SE2_XY 0 0 1 1 1 0 1\nVERTEX_XY 4 1 1\nFIX 4\n"
    )
    again = read_graph_again(path, read_graph(path))
    assert [again.graph.name(k) for k in range(3)] == ["pose 0", "point 0", "point 4"]


@pytest.mark.parametrize("share", [0.3, 0.9, 0.999])
def test_a_compressed_file_that_is_cut_is_refused(tmp_path, share):
    path, lines = tmp_path / "a.g2o", ["VERTEX_SE2 0 0 0 0"]
    lines += [f"EDGE_SE2 {k} {k + 1} 1 0 0.{k} 1 0 0 1 0 1" for k in range(500)]
    packed = gzip.compress("\n".join(lines).encode())
    path.write_bytes(packed)
    assert read_graph(path).graph.size == 501
    path.write_bytes(packed[: int(share * len(packed))])
    with pytest.raises(GraphFormatError, match="the compressed file is cut short after line"):
        read_graph(path)


def test_poses_that_are_one_are_merged_and_written_as_such(tmp_path):
    path = tmp_path / "a.graph"
    edge = "EDGE2 {} {} 1 0 0 4 0 4 9 0 0\n"
    path.write_text(
        "".join(f"VERTEX2 {k} {k} 0 0\n" for k in range(4))
        + "".join(edge.format(k, k + 1) for k in range(4))
        + "EQUIV 3 1\nEQUIV 4 3\n"
    )
    file = read_graph(path)
    assert file.graph.ids[SE2].tolist() == [0, 1, 2]
    (block,) = file.graph.blocks
    # 3 - 4 is gone: both are 1.
    assert np.column_stack(block.variables).tolist() == [[0, 1], [1, 2], [2, 1]]
    assert [line.tolist() for line in file.lines] == [[5, 6, 7]]
    assert file.notes == (
        "2 poses are merged with another; 1 edges between them count for nothing",
    )
    again = read_graph_again(path, file)
    assert again.merged.tolist() == [[3, 1], [4, 1]]
    np.testing.assert_array_equal(again.values[SE2], file.values[SE2])
    assert path.read_text().splitlines()[:5] == [
        *(f"VERTEX2 {k} {float(k)} 0.0 0.0" for k in range(3)),
        *(f"VERTEX2 {k} 1.0 0.0 0.0" for k in (3, 4)),
    ]


def test_merging_a_pose_that_is_not_there_or_all_of_them(tmp_path):
    path = tmp_path / "a.graph"
    path.write_text("VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 1 0 1 1 0 0\nEQUIV 0 1\n")
    file = read_graph(path)
    assert (file.graph.size, file.graph.factors) == (1, 0)
    path.write_text("VERTEX2 0 0 0 0\nEQUIV 0 8\n")
    with pytest.raises(GraphFormatError, match=":2: 8 is to be merged: there is no such pose"):
        read_graph(path)
    path.write_text("VERTEX2 0 0 0 0\nEQUIV 0\n")
    with pytest.raises(GraphFormatError, match=":2: EQUIV: found 1 ids, needed are 2"):
        read_graph(path)


def test_the_order_of_information_is_told_by_what_is_possible(tmp_path):
    path = tmp_path / "a.graph"
    text = "EDGE2 {} {} 1 0 0 {}\n"
    for numbers, diagonal, noted in (
        ("3.16228 0 0 3.16228 0 5", (3.16228, 3.16228, 5.0), True),
        ("3 0 4 5 0 0", (3.0, 4.0, 5.0), False),
        ("2 0.1 2 3 0.1 0.1", (2.0, 2.0, 3.0), False),
    ):
        path.write_text("".join(text.format(k, k + 1, numbers) for k in range(3)))
        file = read_graph(path)
        found = np.diagonal(file.graph.blocks[0].information[0])
        np.testing.assert_array_equal(found, diagonal)
        assert bool(file.notes) == noted
    assert not noted


def test_singular_information_is_told_and_that_with_negative_eigenvalues_refused(
    tmp_path,
):
    path = tmp_path / "a.g2o"
    lines = [
        "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1",
        "EDGE_SE2 0 1 1 0 0 0 0 0 0 0 0",
        "EDGE_SE2 0 1 1 0 0 1 1 0 1 0 1",
        "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 0",
        "EDGE_SE2_XY 0 7 1 0 1e-12 0 1e12",
    ]
    path.write_text("\n".join(lines))
    file = read_graph(path)
    singular, empty = file.notes
    assert singular.startswith(f"2 factors (first {path}:3): information that is singular, which")
    assert empty == f"1 factor (in {path}:2): no information, so they count for nothing"
    path.write_text("\n".join([*lines, *["EDGE_SE2 0 1 1 0 0 1 2 0 1 0 1"] * 3]))
    with pytest.raises(GraphFormatError, match=r":6: the inf.*\(as in 3 factors\).* eigenvalue -1"):
        read_graph(path)
    file = read_graph(path, clip_indefinite=True)
    assert file.notes[0].startswith(f"3 factors (first {path}:6): information with negative")
    # The nearest matrix: the eigenvalue 3 of (1, 1) stays, -1 of (1, -1) is 0.
    wanted = np.array([[1.5, 1.5, 0.0], [1.5, 1.5, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(file.graph.blocks[0].information[4:], [wanted] * 3, atol=1e-15)
    np.testing.assert_array_equal(file.graph.blocks[0].information[0], np.eye(3))


def test_rounded_digits_make_no_matrix_indefinite(tmp_path):
    path = tmp_path / "a.g2o"
    v = np.array([1.0, 2.0, 3.0]) / 7.0
    exact = np.outer(v, v)
    digits = " ".join(f"{exact[i, j]:.15g}" for i in range(3) for j in range(i, 3))
    path.write_text(f"EDGE_SE2 0 1 1 0 0 {digits}\n")
    assert "singular" in read_graph(path).notes[0]


def test_edge3_without_information_has_that_of_one_and_zeros_are_zeros(tmp_path):
    path = tmp_path / "a.graph"
    path.write_text(f"EDGE3 0 1 1 0 0 0 0 0\nEDGE3 0 1 1 0 0 0 0 0 {' '.join('0' * 21)}\n")
    first, second = read_graph(path).graph.blocks[0].information
    np.testing.assert_array_equal(first, np.diag([1.0, 1, 1, 4, 4, 4]))
    assert not second.any()


def test_what_gtsam_has_no_covariance_for_is_named(tmp_path):
    path = tmp_path / "a.g2o"
    path.write_text("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 0\n")
    with pytest.raises(GraphFormatError, match="has covariances, and none for 'between poses'"):
        GTSAM.write(tmp_path / "a.txt", read_graph(path))


def test_few_lines_tell_the_format_also_the_last(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("VERTEX2 0 0 0 0\nODOMETRY 0 1 1 0 0 1 0 0 1 0 1\n")
    assert read_graph(path).graph.factors == 1


@pytest.mark.timeout(600)  # the first of them compiles
@pytest.mark.parametrize("target", TARGETS)
def test_what_fuzzing_has_found_upsets_nothing(target):
    inputs = corpus(target)
    assert len(inputs) > 30
    for data in inputs:
        TARGETS[target](data)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_a_changed_graph_is_refused_or_solved(seed):
    chance = np.random.default_rng(seed)
    data = corpus(str(chance.choice(list(TARGETS))))[0]
    for step in range(3):
        data = mutate(data, LONGEST, seed + step)
    solve(data)


def test_gtsams_text_refuses_points_that_nothing_sees(tmp_path):
    graph = tmp_path / "graph.g2o"
    graph.write_text("VERTEX_SE2 0 0 0 0\nVERTEX_XY 1 2 3\n")
    result = optimise(OptimiseOptions(graph))
    with pytest.raises(RobotctlError, match="nothing sees 1 of the graph's"):
        write_graph(result, tmp_path / "graph.txt")
    assert not (tmp_path / "graph.txt").exists()


def test_an_information_that_is_clipped_beyond_all_bounds_is_refused_with_its_line(tmp_path):
    graph = tmp_path / "graph.g2o"
    graph.write_text("\nEDGE_SE3_TRACKXYZ 1 2 1 0 1 1 0.901 0.001 1e30 0.01 0 0.001\n")
    with pytest.raises(RobotctlError, match=r"graph.g2o:2: the information matrix with 0 in place"):
        read_graph(graph, clip_indefinite=True)


def test_writing_a_graph_takes_little_more_memory_than_its_file_has_bytes(tmp_path):
    count = 5000
    build = GraphBuilder()
    build.factors(
        BETWEEN_2D, np.column_stack([np.arange(count), np.arange(count) + 1]),
        np.random.default_rng(1).normal(size=(count, 3)), np.tile(np.eye(3) / 3.0, (count, 1, 1)),
    )  # fmt: skip
    file = GraphFile(*build.build(), np.empty(0, np.int64))
    tracemalloc.start()
    G2O.write(tmp_path / "graph.g2o", file)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1.5 * (tmp_path / "graph.g2o").stat().st_size
