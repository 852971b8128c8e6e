"""The page about a run, and its paths: what a browser and foreign readers find in them."""

from __future__ import annotations

import base64
import html.parser
import io
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from PIL import Image

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.logs.mcap.log import McapLog
from robotctl.messages.control import Notice
from robotctl.messages.estimation import LiveMap
from robotctl.workbench.logs.rows import RecordingError
from robotctl.workbench.logs.run_report import report_of
from tests.app.simulation.missions import PATROL
from tests.cli.command import status_of
from tests.mavlink.conftest import CONTROL

SCORE = {"mission_completed": False, "seed": 1, "pose_error": {"rmse_m": 0.0123}, "faults": ["<b>"]}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded run with a localiser that draws a map, and an encoder that sticks at its end."""
    folder = tmp_path_factory.mktemp("run")
    faults = tmp_path_factory.mktemp("faults") / "stuck.toml"
    faults.write_text('[[fault]]\nkind = "encoder_stuck"\nwheel = "right"\nat = 6.0\n')
    run_lockstep(
        SimOptions(
            find_file("diff_drive"),
            PATROL,
            record=folder,
            max_seconds=7.0,
            localisation=('localisation.method="mcl"', "localisation.mapping=true"),
            faults=faults,
        )
    )
    return folder


class Page(html.parser.HTMLParser):
    """The parts of a page as a browser takes it apart."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.words: list[str] = []
        self.sources: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [value or "" for name, value in attrs if name in {"src", "href", "srcset"}]

    def handle_data(self, data: str) -> None:
        self.words.append(data.strip())


def test_the_page_shows_what_happened_and_loads_nothing(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    score, out = tmp_path / "score.json", tmp_path / "run.html"
    score.write_text(json.dumps(SCORE))
    assert status_of("report", str(run), "--out", str(out), "--score", str(score)) == 0
    assert capsys.readouterr().out == f"page: {out}\n"
    text = out.read_text("utf-8")
    page = Page(text)
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert "url(" not in text
    assert "b" not in page.tags[: page.tags.index("h2")]  # <b> of the score's text is text
    assert "<b>" in page.words
    assert {"no", "1", "0.0123", "mission completed", "driving"} <= set(page.words)
    assert any("encoder" in words for words in page.words)
    for source in page.sources:
        picture = Image.open(io.BytesIO(base64.b64decode(source.partition(",")[2])))
        picture.load()
        assert min(picture.size) > 400


def test_a_run_says_when_and_why_its_state_changed(run: Path) -> None:
    report = report_of(run, None, lambda done, total: None)
    states = [state for _, state, _ in report.reasons]
    assert states[-1] == "fault"
    assert "driving" in states
    time_s, _, reason = report.reasons[-1]
    assert reason.startswith("right encoder stuck")
    assert 5.5 < time_s < 7.0
    assert report.map is not None
    assert set(report.paths) == {"odometry", "believed", "truth"}
    assert report.score == {}


def test_a_map_lies_where_the_robot_has_it(tmp_path: Path) -> None:
    cells = bytearray([0] * 12)
    cells[2] = 100  # the third of the lowest row
    cells[4] = 255  # unknown
    drawn = LiveMap(2, 3, 4, 0.5, -1.0, 2.0, bytes(cells), theta_rad=0.3)
    with (tmp_path / "robot-0001.mcap").open("wb") as file:
        log = McapLog(file, 0, "rover")
        for message in (CONTROL, Notice(1, 3, "old <news>"), drawn):
            log.add(message)
        log.close()
    report = report_of(tmp_path, None, lambda done, total: None)
    assert report.map is not None
    greys = report.map.greys
    assert greys.shape == (3, 4)
    assert greys[0, 2] == greys.min() == 0
    assert greys[0, 0] == greys.max() == 254
    assert 0 < greys[1, 0] < 254
    assert (report.map.width_m, report.map.height_m) == (2.0, 1.5)
    corner = report.map.corner
    assert (corner.x_m, corner.y_m) == (-1.0, 2.0)
    assert corner.theta_rad == pytest.approx(0.3)
    assert [(line.level, line.text) for line in report.notices] == [("error", "old <news>")]


def test_paths_are_what_the_messages_say(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "paths"
    assert status_of("record", "export", str(run), "--tum", str(out)) == 0
    told = capsys.readouterr().out
    for name in ("odometry", "believed", "truth"):
        assert f"{name}.tum: " in told
    paths = {
        name: pd.read_csv(
            out / f"{name}.tum", sep=" ", names=["t", "x", "y", "z", "qx", "qy", "qz", "qw"]
        )
        for name in ("odometry", "believed", "truth")
    }
    said = {}
    for file in sorted(run.glob("robot-*.mcap")):
        with file.open("rb") as log:
            for _, _, message in make_reader(log).iter_messages(topics=["T_world_base"]):
                content = json.loads(message.data)
                stamp = content["timestamp"]
                said[round(stamp["sec"] + 1e-9 * stamp["nsec"], 6)] = content["pose"]["position"]
    # What is published is odometry by the localiser's transform of the step before.
    gaps = [
        math.hypot(row.x - position["x"], row.y - position["y"])
        for row in paths["believed"].itertuples()
        if (position := said.get(round(row.t, 6))) is not None
    ]
    assert len(gaps) > 50
    assert np.median(gaps) < 3e-3
    assert max(gaps) < 0.05
    gap = np.hypot(
        paths["truth"].x.iloc[-1] - paths["believed"].x.iloc[-1],
        paths["truth"].y.iloc[-1] - paths["believed"].y.iloc[-1],
    )
    assert gap < 0.15


def test_bad_input_is_said(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = next(run.glob("control-*.rec"))
    cases = (
        (("report", str(record), "--out", "a.html"), "no log of states"),
        (("report", str(run), "--out", "a.pdf"), "the suffix must be one of .html, .htm"),
        (("report", str(run), "--out", str(tmp_path / "no" / "a.html")), "does not exist"),
        (("report", str(tmp_path / "no"), "--out", "a.html"), "no such file or folder"),
        (("record", "export", str(run)), "give --csv FOLDER, --tum FOLDER, --tlog FILE"),
        (("record", "export", str(record), "--tum", str(tmp_path / "t")), "no log of states"),
    )
    for words, expected in cases:
        assert status_of(*words) == 2, words
        assert expected in capsys.readouterr().err
    score = tmp_path / "score.json"
    score.write_text("[")
    assert status_of("report", str(run), "--out", "a.html", "--score", str(score)) == 2
    assert "not a file of `sim --report`" in capsys.readouterr().err
    with pytest.raises(RecordingError, match="no such file"):
        report_of(tmp_path / "no", None, lambda done, total: None)


def test_a_simulated_run_leaves_its_page_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    options = ("sim", "--lockstep", "--headless", "--mission", str(PATROL), "--max-seconds", "2")
    assert status_of(*options, "--html", "run.html") == 3
    assert "patrol in flat" in capsys.readouterr().out
    words = Page((tmp_path / "run.html").read_text("utf-8")).words
    assert {"Score", "diff_drive", "Path", "States", "armed"} <= set(words)
    assert [path.name for path in tmp_path.iterdir()] == ["run.html"]
