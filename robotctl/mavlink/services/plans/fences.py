"""The fence: upload, download, switching, and whether the robot is held back by it."""

from __future__ import annotations

from typing import ClassVar, Final

import msgspec
from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.command import ACCEPTED, DENIED, TEMPORARILY_REJECTED, Command
from robotctl.mavlink.context import Context, Request
from robotctl.mavlink.frames import boot_ms
from robotctl.mavlink.missions.fence_items import (
    FencePlan,
    check_fence_item,
    fence_items,
    fence_of,
    read_fence,
)
from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.missions.transfer import Transfer
from robotctl.messages.control import NavigationState
from robotctl.messages.fence import EnableFence, FenceFile, SetFence
from robotctl.messages.mavlink_port import Message

STATUS_HZ: Final = 1.0
"""Rate of FENCE_STATUS [Hz]."""
_MOST: Final = 0xFFFF
"""Greatest count of breaches that it carries."""
_NONE: Final[int] = common.FENCE_BREACH_NONE
_BEYOND: Final[int] = common.FENCE_BREACH_BOUNDARY


class Fences(Transfer[FencePlan]):
    """Takes the fence from one ground station at a time, and gives it to all."""

    commands = frozenset({common.MAV_CMD_DO_FENCE_ENABLE})
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    kind = common.MAV_MISSION_TYPE_FENCE
    word = "fence"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._is_foreign, self._told_by = False, context.origin
        """Whether the fence did not come over MAVLink, and the origin by which it is told."""

    def streams(self) -> tuple[Stream, ...]:
        """Return FENCE_STATUS."""
        group = common.MAV_DATA_STREAM_EXTENDED_STATUS
        return (Stream(common.MAVLINK_MSG_ID_FENCE_STATUS, self._status, STATUS_HZ, group),)

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take DO_FENCE_ENABLE: param1 1 enables, 0 disables."""
        navigation = self._context.fresh_navigation(now_ns)
        wanted = command.whole(0)
        if wanted not in {0, 1}:
            self.say(now_ns, f"{command.params[0]:g} found, 0 or 1 allowed")
            return DENIED
        if navigation is None:
            return TEMPORARILY_REJECTED
        if not navigation.fence.crc:
            self.say(now_ns, "there is none")
            return DENIED
        self._context.requests.append(EnableFence(now_ns, wanted == 1))
        return ACCEPTED

    def read(self, content: bytes) -> FencePlan:
        """Return the fence of a file."""
        return read_fence(content)

    def check(self, item: MissionItem, seq: int) -> None:
        """Check a single item."""
        check_fence_item(item, seq, self._context.origin)

    def plan_of(self, items: list[MissionItem]) -> tuple[FencePlan, list[str]]:
        """Return the shapes of the fence."""
        return fence_of(items, self._context.origin)

    def request(self, plan: FencePlan, file: str, now_ns: int) -> Request:  # noqa: ARG002
        """Return the request to keep to a fence."""
        return SetFence(now_ns, plan.fence, plan.crc)

    def is_taken(self, plan: FencePlan, navigation: NavigationState) -> bool:
        """Return whether the robot keeps to it."""
        return navigation.fence.crc == plan.crc

    def adopt(self, plan: FencePlan, navigation: NavigationState) -> None:
        """Note that a fence is navigation's."""
        super().adopt(plan, navigation)
        self._is_foreign = False
        self._context.fence, self._context.fence_crc = plan.fence, plan.crc

    def step(self, now_ns: int) -> None:
        """Go on with transfers; let stations read a fence that was drawn elsewhere."""
        super().step(now_ns)
        bounds, navigation = self._context.bounds, self._context.fresh_navigation(now_ns)
        if bounds is None or navigation is None or self._offers.are_pending:
            return
        crc, origin = navigation.fence.crc, self._context.origin
        is_new = crc != self._plan.crc or (self._is_foreign and origin != self._told_by)
        if not is_new or bounds.fence_crc != crc:
            return
        content = msgspec.json.encode(FenceFile(bounds.fence)) if crc else b""
        plan = FencePlan(fence_items(bounds.fence, origin), bounds.fence, None, content)
        if plan.crc == crc:
            self.adopt(plan, navigation)
            self._is_foreign, self._told_by = True, origin

    def _status(self, now_ns: int) -> list[Message]:
        """Return FENCE_STATUS, of a robot that has a fence."""
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is None or not navigation.fence.crc:
            return []
        fence = navigation.fence
        return [
            common.MAVLink_fence_status_message(
                int(fence.breached),
                min(fence.breaches, _MOST),
                _BEYOND if fence.breached else _NONE,
                boot_ms(fence.breached_ns),
                common.FENCE_MITIGATE_VEL_LIMIT if fence.limits else common.FENCE_MITIGATE_NONE,
            )
        ]
