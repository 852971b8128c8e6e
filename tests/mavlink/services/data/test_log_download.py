"""Logs over the older messages: a client's side, over links that lose."""

import os
import random

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.app.processes.served_folder import ServedFolder
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.mavlink_port import Peer
from tests.mavlink.conftest import Bench

TEXTS = {
    "run-2/empty.log": b"",
    "run-9/control.log": random.Random(1).randbytes(90 * 7),
    "run-2/control.log": random.Random(2).randbytes(5000),
}
"""In the order of their numbers: the newest last, empty ones first."""
AGES_S = (0, 300, 200)
NOW_S = 1_800_000_000


@pytest.fixture
def bench(tmp_path):
    for (name, text), age_s in zip(TEXTS.items(), AGES_S, strict=True):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(text)
        os.utime(tmp_path / name, (NOW_S - age_s,) * 2)
    bench = Bench(2)
    folders = {"@LOGS": ServedFolder(tmp_path, writable=False)}
    bench.telemetry = Telemetry(bench.config, bench.robot, bench.links, folders=folders)
    bench.step()
    return bench


def entries(bench, first=0, last=0xFFFF):
    bench.take()
    bench.receive(m.MAVLink_log_request_list_message(1, 1, first, last))
    for _ in range(3):
        bench.step()
    return bench.messages("LOG_ENTRY")


FIRST, SECOND = Peer(0, 0), Peer(1, 0)


def ask(bench, number, offset, count, peer=FIRST):
    bench.receive(m.MAVLink_log_request_data_message(1, 1, number, offset, count), peer=peer)


def parts(bench, rng=None):
    """Return what comes of LOG_DATA, by offset; 20 % of it are lost where there is chance."""
    found = {}
    for _ in range(100):
        bench.step()
        sent = bench.messages("LOG_DATA")
        if not sent:
            break
        for each in sent:
            if rng is None or rng.random() > 0.2:
                found[each.ofs] = bytes(each.data[: each.count])
    return found


def test_the_logs_are_listed_with_numbers_and_sizes(bench):
    found = entries(bench)
    assert [(each.id, each.num_logs, each.last_log_num) for each in found] == [
        (1, 3, 3), (2, 3, 3), (3, 3, 3),
    ]  # fmt: skip
    assert [each.size for each in found] == [len(text) for text in TEXTS.values()]
    assert [each.time_utc for each in found] == [0, NOW_S - 300, NOW_S - 200]
    assert [each.id for each in entries(bench, 2, 2)] == [2]
    assert entries(bench, 7, 9) == []


def test_without_logs_one_entry_says_so(make_bench):
    (none,) = entries(make_bench())
    assert (none.num_logs, none.size) == (0, 0)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_log_comes_whole_and_a_short_part_ends_it(bench, number):
    """As ArduPilot has it, of a log of whole parts an empty one is the last."""
    text = list(TEXTS.values())[number - 1]
    ask(bench, number, 0, 0xFFFFFFFF)
    found = parts(bench)
    assert b"".join(found[offset] for offset in sorted(found)) == text
    assert len(found[max(found)]) < 90


def test_lost_parts_are_asked_for_again(bench):
    rng, text = random.Random(3), TEXTS["run-2/control.log"]
    ask(bench, 3, 0, 0xFFFFFFFF)
    found = parts(bench, rng)
    for _ in range(200):
        missing = [offset for offset in range(0, len(text), 90) if offset not in found]
        if not missing:
            break
        ask(bench, 3, missing[0], 90)
        found |= parts(bench, rng)
    assert b"".join(found[offset] for offset in sorted(found))[: len(text)] == text


def test_one_reads_at_a_time_until_it_ends(bench):
    ask(bench, 3, 0, 0xFFFFFFFF, FIRST)
    bench.step()
    bench.take()
    ask(bench, 2, 0, 90, SECOND)
    bench.step()
    assert {peer for _, peer in bench.take("LOG_DATA")} == {FIRST}
    bench.receive(m.MAVLink_log_request_end_message(1, 1), peer=SECOND)
    bench.step()
    assert bench.take("LOG_DATA")
    bench.receive(m.MAVLink_log_request_end_message(1, 1), peer=FIRST)
    ask(bench, 2, 0, 90, SECOND)
    bench.step()
    assert {peer for _, peer in bench.take("LOG_DATA")} == {SECOND}


def test_nothing_is_erased_and_what_is_not_there_is_not_sent(bench, tmp_path):
    bench.receive(m.MAVLink_log_erase_message(1, 1))
    ask(bench, 99, 0, 90)
    bench.step()
    sent = [each for each, _ in bench.take()]
    assert not [each for each in sent if each.get_type() == "LOG_DATA"]
    assert any("remove them" in e.text for e in sent if e.get_type() == "STATUSTEXT")
    assert (tmp_path / "run-2/control.log").read_bytes() == TEXTS["run-2/control.log"]


def test_the_latest_log_as_mavproxy_finds_it_has_content(bench, tmp_path):
    """Its `log download latest` takes the greatest time; others the greatest number."""

    def latest():
        found = entries(bench)
        by_time = max(found, key=lambda each: each.time_utc)
        assert by_time.id == by_time.last_log_num
        ask(bench, by_time.id, 0, 0xFFFFFFFF)
        came = parts(bench)
        bench.receive(m.MAVLink_log_request_end_message(1, 1))
        return b"".join(came[offset] for offset in sorted(came))

    assert latest() == TEXTS["run-2/control.log"]
    (tmp_path / "run-1").mkdir()
    (tmp_path / "run-1" / "new.log").write_bytes(b"new")
    os.utime(tmp_path / "run-1" / "new.log", (NOW_S, NOW_S))
    (tmp_path / "run-9" / "begun.log").write_bytes(b"")
    assert latest() == b"new"
