"""Figures of the computer, from files as Linux writes them (proc(5), sysfs)."""

from pathlib import Path

import pytest

from robotctl.app.processes.computer import Computer


def write(root: Path, stat: str, temperatures: list[str]) -> None:
    (root / "proc").mkdir(exist_ok=True)
    (root / "proc/stat").write_text(stat)
    (root / "proc/meminfo").write_text("MemTotal: 4000 kB\nMemFree: 5 kB\nMemAvailable: 1000 kB\n")
    for number, text in enumerate(temperatures):
        zone = root / f"sys/class/thermal/thermal_zone{number}"
        zone.mkdir(parents=True, exist_ok=True)
        (zone / "temp").write_text(text)


def test_the_processor_is_counted_from_call_to_call_and_the_hottest_sensor_counts(tmp_path):
    # user nice system idle iowait irq softirq steal
    write(
        tmp_path,
        "cpu  100 0 100 700 100 0 0 0\ncpu0 1 1 1 1 1 1 1 1\n",
        ["41000\n", "55500\n", "off"],
    )
    computer = Computer(tmp_path, tmp_path)
    write(tmp_path, "cpu  150 0 110 760 120 0 20 0\n", [])
    state = computer.state()
    assert state.processor == pytest.approx(80 / 160)  # of 160 ticks 80 idle or waiting
    assert state.temperature_c == 55.5
    assert (state.memory_free, state.memory) == (1000 * 1024, 4000 * 1024)
    assert computer.state().processor is None, "no time has passed"


def test_what_a_computer_does_not_tell_is_unknown(tmp_path):
    state = Computer(tmp_path / "gone", tmp_path).state()
    assert (state.processor, state.temperature_c, state.disk_free) == (None, None, None)
