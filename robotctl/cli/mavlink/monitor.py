"""`robotctl mavlink monitor`: what comes over a link."""

from __future__ import annotations

import math
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.console import plain_console
from robotctl.cli.mavlink.link import DEFAULT, Key, Link, companion

if TYPE_CHECKING:
    from rich.console import Group

    from robotctl.workbench.mavlink.monitor import LinkMonitor


_OLD = "dim"
"""Style for messages that have not come for three of their periods."""


def monitor(
    link: Link = DEFAULT,
    key: Key = None,
    seconds: Annotated[
        float, typer.Option(help="End after this time; default: with Ctrl-C.")
    ] = math.inf,
) -> None:
    """Show what comes over a link: messages and their rates, loss, quality of the link."""
    from rich.live import Live  # noqa: PLC0415

    from robotctl.workbench.mavlink.monitor import LinkMonitor  # noqa: PLC0415

    console, seen = plain_console(), LinkMonitor()
    live = Live(console=console, refresh_per_second=4) if console.is_terminal else nullcontext()
    with companion(link, key) as robot, suppress(KeyboardInterrupt), live as view:
        robot.find()
        end_s = robot.now_s + seconds
        while robot.now_s < end_s:
            for received in robot.poll():
                seen.take(received.message, robot.now_s)
            if view is not None:
                view.update(tables(seen, robot.now_s))
    if not console.is_terminal:
        console.print(tables(seen, robot.now_s))


def tables(seen: LinkMonitor, now_s: float) -> Group:
    """Return the tables of senders and of messages."""
    from rich.console import Group  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    senders = Table("system", "component", "received", "lost", "late", "quality", "age s")
    for sender in seen.senders(now_s):
        *numbers, quality, age_s, old = sender
        words = (*map(str, numbers), f"{100.0 * quality:.1f} %", f"{age_s:.1f}")
        senders.add_row(*words, style=_OLD if old else "")
    messages = Table("system", "component", "message", "Hz", "B/s", "count", "age s")
    for row in seen.rows(now_s):
        address = str(row.system), str(row.component)
        figures = f"{row.rate_hz:.1f}", f"{row.bytes_s:.0f}", str(row.total), f"{row.age_s:.1f}"
        messages.add_row(*address, row.name, *figures, style=_OLD if row.old else "")
    return Group(senders, messages)
