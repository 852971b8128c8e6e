"""The link of a command to a running robot."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

if TYPE_CHECKING:
    from robotctl.workbench.mavlink.companion import Companion

Link: TypeAlias = Annotated[
    str, typer.Option(help="udpout, udpin, tcpout, tcpin with HOST:PORT, or serial:/dev/NAME:BAUD.")
]
Key: TypeAlias = Annotated[
    Path | None, typer.Option(help="File with the key, where the robot wants signed messages.")
]
DEFAULT = "tcpout:127.0.0.1:5760"


@contextmanager
def companion(url: str, key: Path | None) -> Iterator[Companion]:
    """Open a link; its robot is still to be found."""
    from robotctl.app.signing_files import read_key  # noqa: PLC0415 - pymavlink is slow
    from robotctl.drivers.mavlink.link import MavlinkLinks  # noqa: PLC0415
    from robotctl.drivers.mavlink.signing import Signing  # noqa: PLC0415
    from robotctl.errors import ConfigError  # noqa: PLC0415
    from robotctl.messages.mavlink_port import LinkConfig  # noqa: PLC0415
    from robotctl.workbench.mavlink.companion import COMPONENT, SYSTEM, Companion  # noqa: PLC0415

    try:
        config = LinkConfig(url)
    except ValueError as error:
        raise ConfigError(f"--link {error}") from error
    signing = None if key is None else Signing(read_key(key))
    with MavlinkLinks((config,), SYSTEM, COMPONENT, signing) as links:
        yield Companion(links, url)
