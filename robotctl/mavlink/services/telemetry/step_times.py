"""NAMED_VALUE_FLOAT: times of navigation's steps, in all and by part."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message

_NAME: Final = 10
"""Most letters of a name."""


class StepTimes(Microservice):
    """Sends, on request, what 99 of 100 of the last steps did not exceed [ms]."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message."""
        return (Stream(common.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT, self._build, 0.0),)

    def _build(self, now_ns: int) -> list[Message]:
        """Return `n_step`, then `n_` and its name for each part."""
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is None or not navigation.budget.parts_p99_ms:
            return []
        budget = navigation.budget
        return [
            common.MAVLink_named_value_float_message(
                frames.boot_ms(navigation.stamp_ns), f"n_{part}"[:_NAME].encode(), ms
            )
            for part, ms in ({"step": budget.p99_ms} | budget.parts_p99_ms).items()
        ]
