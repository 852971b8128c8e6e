"""The graph format of docs/extending.md is read and written by `robotctl optimise`."""

import subprocess
import sys

import pytest

from robotctl.logs.graphs.graph_files import read_graph
from robotctl.logs.graphs.graph_format import GraphFormatError

SQUARE = "from,to,x_m,y_m,theta_rad,sigma\n" + "".join(
    f"{k},{(k + 1) % 4},1.0,0.0,1.5707963,0.1\n" for k in range(4)
)


def test_the_command_reads_and_writes_it(tmp_path):
    (tmp_path / "a.csv").write_text(SQUARE)
    words = ["optimise", str(tmp_path / "a.csv"), "--out", str(tmp_path / "b.csv")]
    done = subprocess.run(
        [sys.executable, "-m", "robotctl", *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "4 variables, 4 factors" in done.stdout
    again = read_graph(tmp_path / "b.csv")
    assert again.graph.factors == 4


def test_a_wrong_line_is_named(tmp_path):
    (tmp_path / "a.csv").write_text(SQUARE + "1,1,0,0,0,1\n")
    with pytest.raises(GraphFormatError, match=r"a\.csv:6: .1,1"):
        read_graph(tmp_path / "a.csv")
