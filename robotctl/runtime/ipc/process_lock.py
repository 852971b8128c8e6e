"""Claims of resources for only one process of this computer, such as the commands on a bus.

A claim is an abstract Unix socket (unix(7)). Its name belongs to the network namespace, as CAN
interfaces do, whoever the user is; the kernel frees it when the process ends, however it ends.
"""

from __future__ import annotations

import errno
import hashlib
import socket
from contextlib import suppress

from robotctl.errors import LinkError


def claim_bus(interface: str, channel: str) -> socket.socket:
    """Claim the commands on a CAN bus, see `claim`.

    Linux also opens a network device by its other names (`ip link`: altname); it is claimed by its
    first name, or by the given one if there is no such device.
    """
    if interface == "socketcan":
        with suppress(OSError):
            channel = socket.if_indextoname(socket.if_nametoindex(channel))
    return claim(f"{interface} {channel}")


def claim(what: str) -> socket.socket:
    """Claim `what` while the returned socket is open.

    Raises
    ------
    LinkError
        If another process holds it.
    """
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f"\0robotctl-{hashlib.sha256(what.encode()).hexdigest()}")
    except OSError as error:
        holder.close()
        if error.errno != errno.EADDRINUSE:
            raise
        raise LinkError(
            f"{what}: another robotctl of this computer has it; end that one first "
            "(a service: systemctl stop robotctl)"
        ) from None
    return holder
