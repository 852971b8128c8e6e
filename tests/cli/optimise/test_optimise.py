"""`robotctl optimise`: from a file to the optimum, its report, picture and file; plain errors."""

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.errors import RobotctlError
from robotctl.logs.graphs.graph_files import read_graph


@pytest.fixture
def square(tmp_path):
    """Return a file with a square of four poses, whose start is far off, and a landmark."""
    lines = [f"VERTEX_SE2 {k} {3 * k} 1 0" for k in range(4)]
    lines += [f"EDGE_SE2 {k} {(k + 1) % 4} 1 0 {np.pi / 2} 4 0 0 4 0 25" for k in range(4)]
    lines += ["EDGE_SE2_XY 0 9 2 1 100 0 100", "EDGE_SE2_XY 2 9 -1 0.1 100 0 100"]
    path = tmp_path / "square.g2o"
    path.write_text("\n".join(lines) + "\n")
    return path


def run(*words):
    result = CliRunner().invoke(app, ["optimise", *map(str, words)])
    if isinstance(result.exception, RobotctlError):
        raise result.exception
    return result


def test_it_writes_optimum_report_and_picture(square, tmp_path):
    out, report, plot = (tmp_path / name for name in ("out.g2o", "r.json", "p.png"))
    result = run(square, "--out", out, "--report", report, "--plot", plot, "--marginals", "2,9")
    assert result.exit_code == 0, result.output
    figures = json.loads(report.read_text())
    assert {"parse", "order", "optimise", "total"} <= figures["time_ms"].keys()
    assert (figures["vertices"], figures["edges"], figures["connected_components"]) == (5, 6, 1)
    assert figures["chi2_final"] < figures["chi2_initial"] < 5.0
    assert (figures["switched_off"], figures["fixed"]) == (0, ["pose 0"])
    assert np.array(figures["marginals"]["2"]).shape == (3, 3)
    assert np.array(figures["marginals"]["9"]).shape == (2, 2)
    assert plot.stat().st_size > 10_000
    # The optimum is where its own file begins, and stays there.
    assert run(out, "--init", "file", "--report", report).exit_code == 0
    again = json.loads(report.read_text())
    assert again["chi2_initial"] == pytest.approx(figures["chi2_final"], abs=1e-9)
    assert read_graph(out).graph.size == 5
    assert "point 9" not in result.output
    assert "9: standard deviations" in result.output


def test_belief_propagation_says_its_rounds_and_how_far_its_means_may_be_off(square, tmp_path):
    report = tmp_path / "r.json"
    exact = run(square, "--report", report)
    chi2 = json.loads(report.read_text())["chi2_final"]
    assert "rounds" not in exact.output
    result = run(square, "--solver", "gbp", "--init", "odometry", "--report", report)
    figures = json.loads(report.read_text())
    assert figures["chi2_final"] == pytest.approx(chi2, rel=1e-6)
    assert figures["left_sigma"] < 0.01
    assert f"{figures['rounds']} rounds of messages" in result.output


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("--solver", "lmm"), 'did you mean "lm"'),
        (("--robust", "hubert"), 'did you mean "huber"'),
        (("--robust", "huber", "--solver", "isam"), "does not work with isam; allowed: consistent"),
        (("--robust", "huber", "--solver", "ekf"), "works with all solvers but ekf"),
        (("--init", "cordal"), 'did you mean "chordal"'),
        (("--marginals", "12"), "--marginals 12: there is no such variable; ids go from 0 to 9"),
        (("--out", "x.csv"), "the suffix says the format"),
    ],
)
def test_a_wrong_option_is_named(square, words, problem):
    with pytest.raises(RobotctlError) as error:
        run(square, *words)
    assert problem in str(error.value)


def test_a_graph_that_is_not_determined_names_the_variable(square):
    with square.open("a") as file:
        file.write("EDGE_BEARING_SE2_XY 1 77 0.3 100\n")
    with pytest.raises(RobotctlError, match="point 77: too few measurements"):
        run(square)


def test_the_film_begins_at_the_start_and_has_a_picture_for_each_iteration(square, tmp_path):
    report, film = tmp_path / "r.json", tmp_path / "film.gif"
    assert run(square, "--init", "file", "--report", report, "--animate", film).exit_code == 0
    with Image.open(film) as pictures:
        assert pictures.n_frames == json.loads(report.read_text())["iterations"] + 1
        first = np.asarray(pictures.convert("L"), float)
        pictures.seek(pictures.n_frames - 1)
        last = np.asarray(pictures.convert("L"), float)
    assert np.abs(first - last).mean() > 0.5
    with pytest.raises(RobotctlError, match="--animate works with gn, lm, dogleg, gbp"):
        run(square, "--solver", "isam", "--animate", film)
    with pytest.raises(RobotctlError, match=r"suffix must be one of \.gif"):
        run(square, "--animate", tmp_path / "film.mp4")


FIXED = """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0.05 1.5707963267948966
VERTEX_SE2 2 1.02 1.0 3.141592653589793
VERTEX_SE2 3 0.02 1.03 -1.5707963267948966
EDGE_SE2 0 1 1 0 1.5707963267948966 100 0 0 100 0 100
EDGE_SE2 1 2 1 0 1.5707963267948966 100 0 0 100 0 100
EDGE_SE2 2 3 1 0 1.5707963267948966 100 0 0 100 0 100
EDGE_SE2 3 0 1 0 1.5707963267948966 100 0 0 100 0 100
"""


def figures_of(path, text, *words, status=0):
    """Return the report on a file, and what was printed."""
    path.write_text(text)
    report = path.with_suffix(".json")
    result = run(path, "--report", report, *words)
    assert result.exit_code == status, result.output
    return json.loads(report.read_text()), result.output


def test_it_says_what_is_fixed_and_what_it_holds_itself(tmp_path):
    path = tmp_path / "a.g2o"
    figures, output = figures_of(path, FIXED + "FIX 0 2\n", "--out", tmp_path / "a.graph")
    assert figures["chi2_final"] == pytest.approx(0.032, abs=1e-6)
    assert (figures["fixed"], figures["held"]) == (["pose 0", "pose 2"], [])
    assert "kept in place: pose 0, pose 2" in output
    assert "a.graph: TORO has no word for fixed variables; g2o has" in output
    figures, output = figures_of(path, FIXED + "EDGE_PRIOR_SE2_XY 0 5 6 1 0 1\n")
    assert (figures["fixed"], figures["held"]) == ([], ["pose 0: rotation"])
    assert "kept in place: pose 0: rotation" in output
    figures, output = figures_of(path, FIXED + "EDGE_PRIOR_SE2 3 5 6 1 1 0 0 1 0 1\n")
    assert (figures["fixed"], figures["held"]) == ([], [])
    assert "kept in place: nothing, priors do that" in output
    figures, output = figures_of(path, FIXED + "FIX 0 1 2 3\n", "--marginals", "1")
    assert (figures["chi2_initial"], figures["iterations"]) == (figures["chi2_final"], 0)
    assert figures["chi2_final"] == pytest.approx(0.76)
    assert "all variables are fixed: there is nothing to find" in output


def test_information_with_negative_eigenvalues_is_clipped_if_that_is_wanted(tmp_path):
    path, text = tmp_path / "a.g2o", FIXED + "EDGE_SE2 0 2 1 1 3 1 2 0 1 0 1\n"
    with pytest.raises(RobotctlError, match=r":9: the information matrix .*--clip-indefinite"):
        figures_of(path, text)
    figures, output = figures_of(path, text, "--clip-indefinite")
    (note,) = figures["notes"]
    assert "information with negative eigenvalues" in note
    assert f"note: {note}" in output


def test_it_says_what_to_try_where_the_result_is_doubtful(tmp_path):
    path = tmp_path / "a.g2o"
    figures, output = figures_of(path, FIXED)
    assert (figures["degrees_of_freedom"], figures["advice"]) == (3, "")
    contradiction = "EDGE_SE2 0 2 3 3 0 100 0 0 100 0 100\n"
    figures, output = figures_of(path, FIXED + contradiction)
    assert figures["converged"]
    assert "times the degrees of freedom (6)" in figures["advice"]
    assert "try --solver isam" in figures["advice"]
    assert figures["advice"] in output
    figures, output = figures_of(path, FIXED + contradiction, "--solver", "ekf", status=1)
    assert not figures["converged"]
    assert "not converged: a filter does not go back" in output
    assert "try --solver isam or lm" in output


def test_an_id_beyond_64_bits_is_none(square):
    with pytest.raises(RobotctlError, match="there is no such variable; ids go from 0 to 9"):
        run(square, "--marginals", "99999999999999999999")
