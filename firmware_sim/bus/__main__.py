"""`python -m firmware_sim.bus`: a simulated bus for tools, with no firmware on it.

Two programs on it acknowledge each other's frames. A single one gets acknowledge errors, as on
copper, unless `--ack` puts a silent listener on the bus.
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

from firmware_sim.bus import fd_bits
from firmware_sim.bus.bridge import Bridge
from firmware_sim.bus.core import Bus
from firmware_sim.bus.frame import Frame
from firmware_sim.bus.hub import Hub, HubError
from firmware_sim.bus.log import LogWriter
from firmware_sim.bus.serve import Service, serve
from firmware_sim.command_line import Parser, parse_natural

_LOG = logging.getLogger("firmware_sim.bus")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    result = Parser(
        prog="python -m firmware_sim.bus", description="Run a simulated CAN bus for python-can."
    )
    result.add_argument("--channel", default="simcan0", help="name or socket path (%(default)s)")
    result.add_argument("--bitrate", type=int, default=1_000_000, help="bit/s (%(default)s)")
    result.add_argument(
        "--data-bitrate",
        type=parse_natural,
        default=0,
        help="of CAN FD, bit/s (default 0: classic CAN)",
    )
    result.add_argument(
        "--seed", type=parse_natural, default=0, help="seed of random faults (%(default)s)"
    )
    result.add_argument("--log", type=Path, help="write a candump log to this file")
    result.add_argument("--bridge", metavar="INTERFACE", help="couple it to vcan0 or the like")
    result.add_argument("--ack", action="store_true", help="add a node that acknowledges")
    return result


def run(arguments: argparse.Namespace, stopping: list[int]) -> None:
    """Run the bus until `stopping` has an entry.

    Raises
    ------
    HubError, OSError, ValueError
        If the bus, its channel, its log or its bridge cannot be had.
    """
    fd_bits.warm()
    origin_ns = time.monotonic_ns()
    bus = Bus(arguments.bitrate, arguments.seed, data_bitrate=arguments.data_bitrate)
    with ExitStack() as stack:
        hub = stack.enter_context(closing(Hub(bus, arguments.channel, origin_ns=origin_ns)))
        services: list[Service] = [hub]
        if arguments.bridge:
            bridge = Bridge.open(bus, arguments.bridge)
            services.append(stack.enter_context(closing(bridge)))
        if arguments.log:
            epoch_ns = time.time_ns() - (time.monotonic_ns() - origin_ns)
            log = LogWriter(bus, arguments.log, _log_name(arguments.channel), epoch_ns=epoch_ns)
            stack.enter_context(closing(log))
        if arguments.ack:
            bus.attach("ack", _ignore, accept=())
        rates = f"{bus.bitrate}/{bus.data_bitrate}" if bus.data_bitrate else f"{bus.bitrate}"
        _LOG.info("%s: %s bit/s at %s", arguments.channel, rates, hub.path)
        serve(bus, services, origin_ns=origin_ns, stop=lambda: bool(stopping))
        errors = sum(bus.statistics.errors.values())
        _LOG.info("%s: %d frames, %d errors", arguments.channel, bus.statistics.frames, errors)


def _ignore(frame: Frame) -> None:
    """Take a frame and do nothing with it."""


def _log_name(channel: str) -> str:
    return Path(channel).stem if "/" in channel else channel


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status: 0, or 2 when the bus cannot be had."""
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    stopping: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: stopping.append(number))
    try:
        run(parser().parse_args(arguments), stopping)
    except (HubError, OSError, ValueError) as error:
        _LOG.error("%s", error)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
