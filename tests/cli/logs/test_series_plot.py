"""`robotctl plot`: pictures, and words where there is no window."""

import importlib.util
from pathlib import Path

import pytest

from tests.cli.command import status_of
from tests.workbench.logs.test_series import drive, write_log


@pytest.fixture(autouse=True)
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log with a restart and a gap, on a computer without a display."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    path = tmp_path / "robot-0001.mcap"
    write_log(path, *drive(0.0, 2.0, 100), *drive(5.0, 6.0, 1))
    return path


@pytest.mark.parametrize(
    ("name", "begin"), [("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.pdf", b"%PDF")]
)
def test_a_picture_is_drawn_in_the_kind_that_its_name_says(
    run: Path, name: str, begin: bytes
) -> None:
    out = run.parent / name
    fields = ("control.v_m_s", "control.duty", "T_world_base.theta_rad")
    assert status_of("plot", run, *fields, "--out", out) == 0
    assert out.read_bytes().startswith(begin)


def test_a_picture_has_a_panel_for_each_unit_a_gap_a_restart_and_the_states(run: Path) -> None:
    from matplotlib.figure import Figure

    from robotctl.cli.logs.series_plot import draw
    from robotctl.workbench.logs.series import select

    fields = ("control.v_m_s", "control.v_ref_m_s", "control.omega_rad_s")
    figure = Figure()
    draw(figure, select(run, fields, lambda done, total: None), "a run")
    speeds, turns = figure.axes
    assert (speeds.get_ylabel(), turns.get_ylabel()) == ("m/s", "rad/s")
    lines = [line for line in speeds.lines if line.get_label() == "control.v_m_s"]
    (x, y) = lines[0].get_data()
    assert len(x) == 151
    assert y[100] != y[100]  # nan: the line breaks
    assert x[100] == pytest.approx(5.0)
    assert [line.get_xdata()[0] for line in turns.lines if line.get_linestyle() == "--"] == [
        pytest.approx(5.0)
    ]
    assert len(turns.patches) == 2  # standby, twice
    explained = [text.get_text() for text in figure.legends[0].get_texts()]
    assert explained == ["standby", "control anew"]


def test_without_a_display_figures_gaps_states_and_restarts_are_printed(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of("plot", run, "control.v_m_s") == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        "control.v_m_s: 150 values from 0.00 to 5.98 s; 0 to 0.598 m/s, mean 0.249 m/s",
        "  no messages from 1.98 to 5.00 s",
        "state: standby 0.00 to 1.98 s, standby 5.00 to 5.98 s",
        "control restarted at 5.00 s",
    ]
    assert "--out FILE.png" in said.err


def test_without_matplotlib_words_are_left(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "matplotlib" else find_spec(name)
    )
    monkeypatch.setenv("DISPLAY", ":0")
    assert status_of("plot", run, "control.v_m_s") == 0
    assert capsys.readouterr().out.startswith("control.v_m_s: 150 values")
    assert status_of("plot", run, "control.v_m_s", "--out", run.parent / "a.png") == 2
    assert "--out needs matplotlib, which is not installed" in capsys.readouterr().err


def test_a_wrong_suffix_a_missing_folder_and_a_bare_topic_are_refused_before_anything_is_read(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of("plot", run, "control.v_m_s", "--out", run.parent / "a.jpg") == 2
    assert "the suffix must be one of .png, .svg, .pdf" in capsys.readouterr().err
    assert status_of("plot", run, "control.v_m_s", "--out", run.parent / "no" / "a.png") == 2
    assert "does not exist" in capsys.readouterr().err
    assert status_of("plot", "nowhere", "control") == 2
    assert "control: give topic and field, such as control.v_m_s" in capsys.readouterr().err
