"""Rates, loss and quality of what comes over a link."""

import io
import math

import pytest
from pymavlink.dialects.v20 import common as m
from rich.console import Console

from robotctl.cli.mavlink.monitor import tables
from robotctl.workbench.mavlink.monitor import WINDOW_S, LinkMonitor

ATTITUDE = m.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)
SIZE = 12 + 28


def message(seq, system=1):
    codec = m.MAVLink(None, system, 1)
    codec.seq = seq % 256
    # MAVLink 2 leaves out zeros at the end; with a last byte that is none, the payload is whole.
    whole = m.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 1.0)
    return codec.decode(bytearray(whole.pack(codec)))


def fed(numbers, rate_hz=10.0):
    monitor = LinkMonitor()
    for place, number in enumerate(numbers):
        monitor.take(message(number), place / rate_hz)
    return monitor, (len(numbers) - 1) / rate_hz


def test_rates_are_those_of_the_last_seconds():
    monitor, now_s = fed(range(200))
    ((system, component, name, rate_hz, bytes_s, total, *_),) = monitor.rows(now_s)
    assert (system, component, name, total) == (1, 1, "ATTITUDE", 200)
    assert rate_hz == pytest.approx(10.0, abs=0.3)
    assert bytes_s == pytest.approx(10.0 * SIZE, abs=0.3 * SIZE)
    assert monitor.rows(now_s + 2 * WINDOW_S)[0].rate_hz == 0.0
    assert math.isnan(monitor.senders(now_s + 2 * WINDOW_S)[0].quality)


def test_gaps_are_losses_over_the_end_of_the_numbers_too():
    numbers = [number for number in range(250, 290) if number % 5]
    monitor, now_s = fed(numbers)
    (sender,) = monitor.senders(now_s)
    assert (sender.received, sender.lost, sender.late) == (32, 7, 0)
    assert sender.quality == pytest.approx(32 / 39)


def test_what_is_repeated_or_late_is_no_loss():
    monitor, now_s = fed([1, 2, 2, 5, 3, 6])
    (sender,) = monitor.senders(now_s)
    assert (sender.received, sender.lost, sender.late) == (4, 2, 2)


def test_senders_are_told_apart_and_shown():
    monitor = LinkMonitor()
    for number in range(10):
        monitor.take(message(number, system=1), number / 10)
        monitor.take(message(3 * number, system=2), number / 10)
    first, second = monitor.senders(1.0)
    assert (first.lost, second.lost) == (0, 18)
    assert len(tables(monitor, 1.0).renderables) == 2


def test_what_has_not_come_for_three_of_its_periods_is_old_and_has_its_age():
    monitor = LinkMonitor()
    for number in range(21):
        monitor.take(message(number, system=1), number / 10)
        if number <= 10:
            monitor.take(message(number, system=2), number / 10)
    fresh, silent = monitor.rows(2.0)
    assert (fresh.age_s, fresh.old) == (0.0, False)
    assert (silent.age_s, silent.old) == (pytest.approx(1.0), True)
    assert [each.old for each in monitor.senders(2.0)] == [False, True]
    assert not monitor.rows(2.29)[0].old
    assert monitor.rows(2.31)[0].old


def test_an_old_row_is_grey_and_tells_its_age():
    monitor = LinkMonitor()
    for number in range(11):
        monitor.take(message(number), number / 10)
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    console.print(tables(monitor, 8.0))
    grey = [line for line in console.file.getvalue().splitlines() if "\x1b[2m" in line]
    assert len(grey) == 2
    assert all("7.0" in line for line in grey)
