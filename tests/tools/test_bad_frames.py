"""20 000 bad frames at both receivers; `tools/bad_frames.py` does the same with millions."""

import math

import pytest

from bad_frames import (
    CERTAIN,
    INJECTED,
    STATISTICAL,
    Row,
    judge_injected,
    judge_made,
    main,
    shares,
)


@pytest.fixture(scope="module")
def rows():
    return [*judge_made(600, seed=7), *judge_injected(300, seed=7)]


def test_no_bad_frame_passes_of_the_classes_that_profile_1_rejects_by_construction(rows):
    certain = [row for row in rows if row.share == 0.0]
    assert {row.name for row in certain} == {*CERTAIN, *INJECTED} - {
        "injector: 30 % are 2.5 periods late"
    }
    assert {row.receiver for row in certain} == {"host", "firmware"}
    assert sum(row.frames for row in rows) > 20_000
    assert [row for row in certain if row.accepted] == []


def test_of_the_other_classes_as_much_passes_as_theory_says(rows):
    statistical = [row for row in rows if row.share]
    assert {row.name for row in statistical} == set(STATISTICAL)
    assert [row for row in statistical if not row.right] == []


def test_both_receivers_judge_what_the_injector_makes_alike(rows):
    injected = [(row.name, row.frames, row.accepted) for row in rows if row.name in INJECTED]
    assert injected[::2] == injected[1::2]


def test_theory_is_what_a_count_by_hand_gives():
    theory = shares()
    assert theory["random bytes"] == pytest.approx(3 / 4096)
    assert theory["stale by 0 to 14 frames"] == pytest.approx(3 / 15)
    # Of the words of three bits about one in 256 is a code word; a little fewer pass the counter.
    assert theory["three bits wrong"] == pytest.approx(1 / 256, rel=0.25)


@pytest.mark.parametrize(
    ("frames", "accepted", "share", "right"),
    [
        (1000, 0, 0.0, True),
        (1000, 1, 0.0, False),
        (10_000, 2000, 0.2, True),
        (10_000, 2000 + 5 * 40, 0.2, True),
        (10_000, 2000 + 5 * 40 + 1, 0.2, False),
        (10_000, 2000 - 5 * 40 - 1, 0.2, False),
        (10, 10, None, True),
    ],
)
def test_a_row_is_right_within_five_standard_deviations(frames, accepted, share, right):
    assert math.sqrt(10_000 * 0.2 * 0.8) == 40
    assert Row("class", "host", frames, accepted, share).right is right


def test_the_command_prints_a_table_and_its_sums(capsys):
    assert main(["--frames", "20"]) == 0
    out = capsys.readouterr().out.splitlines()
    assert len(out) == 2 + 2 * (len(CERTAIN) + len(STATISTICAL) + len(INJECTED))
    assert ", 0 accepted;" in out[-1]
