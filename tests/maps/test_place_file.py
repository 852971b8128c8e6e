"""The file of known places: whole, or an error that says what is wrong and where."""

import math
import os
import re

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.signatures import Signature, SignatureConfig
from robotctl.maps.place_file import load_book, save_book
from robotctl.model.geometry.se2 import SE2

CONFIG = SignatureConfig(bearings=24, max_range_m=3.5)


def signature(seed):
    rng = np.random.default_rng(seed)
    silence = rng.choice([0.0, 0.25, 0.99999, 1.0, np.nan], 24, p=[0.5, 0.2, 0.1, 0.1, 0.1])
    depth = np.where(silence < 1.0, rng.uniform(0.1, 3.4, 24), np.nan)
    return Signature(depth, silence)


@pytest.fixture
def book():
    found = PlaceBook(signatures=CONFIG)
    for name, seed, pose in (
        ("kitchen", 1, SE2(1.25, -2.5, 0.7)),
        ("kitchen", 1, SE2(1.26, -2.5, 0.6)),
        ('the "Küche", 2', 2, None),
    ):
        found = found.learned(name, signature(seed), pose)
    return found


@pytest.fixture
def file(book, tmp_path):
    path = tmp_path / "book.toml"
    save_book(path, book)
    return path


def test_what_was_saved_is_loaded(book, file):
    loaded = load_book(file)
    assert loaded.signatures == CONFIG
    assert [(p.name, p.in_world) for p in loaded.places] == [
        ("kitchen", True), ('the "Küche", 2', False)
    ]  # fmt: skip
    for before, after in zip(book.places, loaded.places, strict=True):
        for old, new in zip(before.visits, after.visits, strict=True):
            assert new.pose.x_m == pytest.approx(old.pose.x_m, abs=1e-4)
            assert new.pose.theta_rad == pytest.approx(old.pose.theta_rad, abs=1e-5)
            assert np.allclose(
                new.signature.depth_m, old.signature.depth_m, atol=5e-4, equal_nan=True
            )
            assert np.allclose(
                new.signature.silence, old.signature.silence, atol=1e-4, equal_nan=True
            )
    assert loaded.threshold == pytest.approx(book.threshold, abs=2e-3)


def test_saved_again_it_is_the_same_to_the_byte(file):
    text = file.read_bytes()
    save_book(file, load_book(file))
    assert file.read_bytes() == text
    assert [path.name for path in file.parent.iterdir()] == ["book.toml"]


def test_an_empty_book_is_one(tmp_path):
    save_book(tmp_path / "b.toml", PlaceBook())
    assert load_book(tmp_path / "b.toml").places == ()


@pytest.mark.parametrize(
    ("pattern", "by", "says"),
    [
        (r"version = 1", "version = 2", r"version 2 of the file found, 1 is read"),
        (r"bearings = 24", "bearings = 36", r"24 bearings, 36 allowed"),
        (r"bearings = 24\n", "", r"bearings: missing key"),
        (r"max_range_m", "max_rnge_m", r':7: max_rnge_m: unknown key; did you mean "max_range_m"'),
        (r'frame = "world"', 'frame = "wrld"', r":12: place\[0\]\.frame: .*'wrld'"),
        (r'name = "kitchen"', 'name = ""', r"name: must be printable"),
        (r'name = "the.*', 'name = "kitchen"', r"place kitchen: the name is given 2 times"),
        (r"x_m = 1\.25\d*", "x_m = nan", r":15: place\[0\]\.visit\[0\]\.x_m: must be finite"),
        (r"depth_m = \[\n +", "depth_m = [\n    -1.0, ", r"must both be \(n,\)"),
        (r"silence = \[\n +[\d.]+", "silence = [\n    7.0", r"silence: must be in \[0, 1\]"),
        (r"depth_m = \[[^]]*\]", "depth_m = [0.5]", r"place\[0\]\.visit\[0\]: .*must both be"),
        (r"\[\[place\.visit\]\]", "[[place.visit", r"not valid TOML"),
        (r"0\.", "x.", r"not valid TOML"),
    ],
)
def test_a_damaged_file_is_refused_with_the_place_of_the_damage(file, pattern, by, says):
    text = file.read_text(encoding="utf-8")
    damaged = re.sub(pattern, by, text, count=1)
    assert damaged != text
    file.write_text(damaged, encoding="utf-8")
    with pytest.raises(ConfigError, match=says) as raised:
        load_book(file)
    assert str(file) in str(raised.value)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.995])
def test_a_file_that_was_cut_within_a_visit_is_refused(file, share):
    text = file.read_text(encoding="utf-8")
    file.write_text(text[: int(share * len(text))], encoding="utf-8")
    with pytest.raises(ConfigError):
        load_book(file)


def test_a_missing_file_is_named_with_its_nearest(file):
    with pytest.raises(ConfigError, match=r'did you mean "book\.toml"'):
        load_book(file.with_name("bok.toml"))


def test_a_disk_that_refuses_leaves_the_old_file(file, book, monkeypatch):
    before = file.read_bytes()

    def refuse(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(ConfigError, match="No space left"):
        save_book(file, book.learned("more", signature(5), SE2(0, 0, math.pi)))
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == ["book.toml"]


def test_a_folder_that_is_not_there_is_named(tmp_path, book):
    with pytest.raises(ConfigError, match="nowhere"):
        save_book(tmp_path / "nowhere" / "b.toml", book)
