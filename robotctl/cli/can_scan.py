"""Scans the buses for `robotctl can scan`, and prints what was found."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from json import dumps
from typing import TypeAlias

import msgspec
from rich.console import Console
from rich.table import Table

from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.port import SocketPort
from robotctl.drivers.can.scan_tables import motor_tables
from robotctl.drivers.can.scanner import Scanner, ScanReport
from robotctl.errors import LinkError
from robotctl.runtime.clock import RealClock
from robotctl.runtime.ipc.process_lock import claim_bus

Reports: TypeAlias = list[tuple[CanConfig, ScanReport]]


def scan_buses(buses: Sequence[CanConfig]) -> Reports:
    """Scan one bus after another; one whose controller runs on this computer is only listened to.

    Raises
    ------
    LinkError
        If a bus cannot be opened.
    """
    return [(bus, _scan(bus)) for bus in buses]


def _scan(bus: CanConfig) -> ScanReport:
    clock = RealClock()
    with ExitStack() as held:
        only_listen = False
        try:
            held.enter_context(claim_bus(bus.interface, bus.channel))
        except LinkError:
            only_listen = True
        port = SocketPort(bus, None, clock)
        held.callback(port.close)
        return Scanner(port, bus, clock).run(only_listen=only_listen)


def print_json(reports: Reports) -> None:
    """Print all reports, each with its bus."""
    found = [{"bus": bus, "report": report} for bus, report in reports]
    print(dumps(msgspec.to_builtins(found), indent=2))


def print_reports(console: Console, reports: Reports, wheels: Sequence[str]) -> None:
    """Print a table of the devices on each bus, what to mend, and tables for the robot's file."""
    first = reports[0][0].name
    left = list(wheels)
    for bus, report in reports:
        if report.found:
            console.print(_table(bus, report))
        else:
            console.print(f"{bus.channel}: no device found in {report.duration_ms / 1e3:.1f} s")
        if report.text:
            console.print(f"{report.verdict.value}: {report.text}")
        if report.fix:
            console.print(f"-> {report.fix}")
        if report.not_asked:
            devices = ", ".join(report.not_asked)
            console.print(f"not asked all, as it might command another device: {devices}")
        tables = motor_tables(report.found, left, "" if bus.name == first else bus.name)
        if tables:
            del left[: sum(each.axes for each in report.found if each.kind)]
            console.print(
                "\nFor the robot's file; wheels, ratios and directions are yours to check:"
            )
            console.print(f"\n{tables}", soft_wrap=True)


def _table(bus: CanConfig, report: ScanReport) -> Table:
    """Return the devices on a bus as a table."""
    rates = f"{bus.bitrate}, data {bus.data_bitrate}" if bus.data_bitrate else f"{bus.bitrate}"
    title = f"{bus.channel}, {rates} bit/s: scanned in {report.duration_ms / 1e3:.1f} s"
    table = Table(title=title)
    for heading in ("protocol", "id", "device", "firmware", "state"):
        table.add_column(heading, justify="right" if heading == "id" else "left")
    for each in report.found:
        state = f"{each.state}; {each.clash}" if each.clash else each.state
        table.add_row(each.protocol, str(each.number), each.name, each.firmware, state)
    return table
