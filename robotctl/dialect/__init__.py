"""The MAVLink dialect that robotctl speaks: pymavlink's `common`, and what that lacks.

Importing this package makes pymavlink's codec of MAVLink 2 know all of it, for the whole process.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.dialect.additions import MESSAGES

# A codec of pymavlink looks into the table of its module: it has no other way to learn messages.
common.mavlink_map.update(MESSAGES)
