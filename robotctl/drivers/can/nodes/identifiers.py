"""Numbers of CANopen that all of its services share: identifiers, and network management."""

from __future__ import annotations

import enum
from typing import Final


class CobId(enum.IntEnum):
    """Identifiers of the predefined connection set, less the node id (CiA 301, 7.3.5)."""

    NMT = 0x000
    SYNC = 0x080
    EMERGENCY = 0x080  # SYNC is that of no node
    TPDO = 0x180
    RPDO = 0x200
    SDO_RESPONSE = 0x580
    SDO_REQUEST = 0x600
    HEARTBEAT = 0x700


PDO_STEP: Final = 0x100
"""Distance of the identifiers of one PDO from those of the next."""

NODE_ID_MAX: Final = 127
"""Greatest node id (CiA 301, 7.3.5)."""


class NmtState(enum.IntEnum):
    """State of a node in its heartbeat (CiA 301, 7.2.8.3.2)."""

    BOOT_UP = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class NmtCommand(enum.IntEnum):
    """Command specifiers of network management (CiA 301, 7.2.8.3.1)."""

    START = 1
    STOP = 2
    ENTER_PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130
