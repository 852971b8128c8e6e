"""The MAVLink dialect that robotctl speaks: pymavlink's `common`, and what that lacks.

Importing this package makes pymavlink's codec of MAVLink 2 know all of it, for the whole process.

Public names:

- `additions.MAVLink_command_cancel_message`, and so on: the messages that robotctl.xml adds
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.dialect.additions import MESSAGES

# A codec of pymavlink looks into the table of its module: it has no other way to learn messages.
common.mavlink_map.update(MESSAGES)
