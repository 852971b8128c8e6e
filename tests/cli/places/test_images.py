"""`robotctl places match` and `train-vocabulary` as a user types them."""

import csv

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.errors import ConfigError, PlaceError
from tests.estimation.places.visual.drawn import drawn_wall


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two laps past eight walls: 1.png to 16.png, the truth among them."""
    path = tmp_path_factory.mktemp("images")
    for i in range(16):
        shift = 10 * (i // 8)
        cv2.imwrite(str(path / f"{i + 1}.png"), drawn_wall(i % 8)[shift : shift + 300, :400])
    truth = np.eye(16, k=-8, dtype=np.uint8) * 255
    cv2.imwrite(str(path / "truth.bmp"), truth)
    return path


def run(*words):
    return CliRunner().invoke(app, ["places", *map(str, words)])


def test_a_drive_is_matched_with_itself(folder, tmp_path):
    truth, out, plot = folder / "truth.bmp", tmp_path / "pairs.csv", tmp_path / "pairs.png"
    words = ("match", folder, "--truth", truth, "--gap", 3, "--out", out, "--plot", plot)
    result = run(*words)
    assert result.exit_code == 0, result.output
    assert "9.png: as 1.png, " in result.output
    assert "8 of 16 images recognised; " in result.output
    assert "precision 1.000: 8 of 8 are right" in result.output
    assert "recall 1.000: 8 of 8 that are possible" in result.output
    assert plot.read_bytes().startswith(b"\x89PNG")
    with out.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    accepted = [(row["image"], row["candidate"]) for row in rows if row["accepted"] == "1"]
    files = [str(folder / f"{i}.png") for i in range(1, 17)]
    assert accepted == list(zip(files[8:], files[:8], strict=True))
    assert all((row["accepted"] == "1") == (row["reason"] == "") for row in rows)
    assert list(dict.fromkeys(row["image"] for row in rows)) == files


def test_single_images_are_recognised_among_others(folder):
    lap = [word for i in range(1, 9) for word in ("--against", folder / f"{i}.png")]
    result = run("match", folder / "12.png", *lap)
    assert result.exit_code == 0, result.output
    assert result.output.startswith("12.png: as 4.png, ")


def test_a_vocabulary_is_trained_and_used(folder, tmp_path):
    out = tmp_path / "words.npz"
    images = [folder / f"{i}.png" for i in range(1, 5)]
    trained = run("train-vocabulary", *images, "--out", out, "--seed", 3)
    assert trained.exit_code == 0, trained.output
    assert f"{out}: " in trained.output
    assert "words from 4 images" in trained.output
    first = out.read_bytes()
    run("train-vocabulary", *images, "--out", out, "--seed", 3)
    assert out.read_bytes() == first
    result = run("match", folder, "--truth", folder / "truth.bmp", "--gap", 3, "--vocabulary", out)
    assert "precision 1.000" in result.output


def test_bad_input_is_said_with_its_file(folder, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.png").write_bytes(b"no image")
    cv2.imwrite(str(tmp_path / "plain.png"), np.full((80, 80), 90, np.uint8))
    (tmp_path / "small.txt").write_text("0 1\n1 0\n", encoding="utf-8")
    refused = {
        ("match", tmp_path / "empty"): "no images in it",
        ("match", tmp_path / "none.png"): "no such file or folder",
        ("match", tmp_path / "broken.png"): "broken.png: no image",
        ("match", folder, "--truth", tmp_path / "small.txt"): "2 rows and 2 columns; needed are",
        ("match", folder, "--truth", tmp_path / "none.bmp"): "none.bmp",
        ("match", folder, "--vocabulary", tmp_path / "small.txt"): "no vocabulary",
        ("train-vocabulary", folder, "--out", tmp_path / "none" / "v.npz"): "does not exist",
    }
    for words, text in refused.items():
        result = run(*words)
        assert isinstance(result.exception, ConfigError), result.output
        assert text in str(result.exception)
    result = run("train-vocabulary", tmp_path / "plain.png", "--out", tmp_path / "v.npz")
    assert isinstance(result.exception, PlaceError)
    assert "1 images: they must have 100 features or more, found 0" in str(result.exception)


@pytest.mark.recordings("places/rtabmap")
def test_a_building_driven_twice_is_recognised_without_a_false_place(recordings):
    images = recordings / "places" / "rtabmap"
    result = run("match", images, "--truth", images / "samples_GT.bmp")
    assert "precision 1.000" in result.output
    right = int(result.output.partition("\nrecall ")[2].split()[1])
    assert right >= 33  # of 44
