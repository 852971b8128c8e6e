"""Watchdog of an ODrive axis: messages that feed it, expiry, and settings.

Sources: for 0.5 odriverobotics/ODrive, Firmware/MotorControl/axis.cpp and
Firmware/communication/can/can_simple.cpp (any message to the axis feeds it, and it expires in any
state); for 0.6 odriverobotics/ODriveResources, examples/can_watchdog.py (Set_Axis_State and
Set_Input_Vel feed it).
"""

from __future__ import annotations

from typing import Final

from firmware_sim.drives.odrive import wire
from firmware_sim.drives.odrive.settings import ODriveSettings
from firmware_sim.drives.twin import NEVER_NS, stored
from firmware_sim.nodes.parameter_store import ParameterStore

_FEEDS: Final = frozenset(
    {wire.SET_AXIS_STATE, wire.SET_INPUT_POS, wire.SET_INPUT_VEL, wire.SET_INPUT_TORQUE}
)


class Watchdog:
    """Counts the time since the axis was last fed.

    Parameters
    ----------
    settings
        The true drive.
    store
        Memory of its saved settings.
    """

    def __init__(self, settings: ODriveSettings, store: ParameterStore) -> None:
        self._settings = settings
        self._store = store
        is_old = settings.firmware < wire.FIRST_06
        self._fed_by_any = is_old or settings.watchdog_fed_by == "any"
        self._always = is_old or settings.watchdog_while_idle
        self.start(NEVER_NS)

    def start(self, ready_ns: int) -> None:
        """Load the stored settings; the drive is ready at `ready_ns` [ns]."""
        flash = stored(self._store)
        watchdog_ms = self._settings.watchdog_ms
        self.is_on = bool(flash.get((0, 1), watchdog_ms > 0.0))
        self.timeout = wire.FLOAT.pack(watchdog_ms / 1000.0)
        if (0, 0) in flash:
            self.timeout = wire.UINT32.pack(flash[0, 0])
        self._expires_ns = ready_ns + self._timeout_ns()

    def _timeout_ns(self) -> int:
        seconds = wire.FLOAT.unpack(self.timeout)[0]
        return round(seconds * 1e9) if 0.0 <= seconds < 1e6 else 0

    def feed(self, command: int, now_ns: int) -> None:
        """Feed the watchdog if the message does so."""
        if self._fed_by_any or command in _FEEDS:
            self._expires_ns = now_ns + self._timeout_ns()

    def due_ns(self, *, is_armed: bool) -> int:
        """Return the time of expiry [ns]."""
        return self._expires_ns if self.is_on and (self._always or is_armed) else NEVER_NS

    def access(self, opcode: int, endpoint: int, value: bytes) -> bytes | None:
        """Read or write one of its two endpoints; return its value, None for another endpoint."""
        timeout, enable = self._settings.sdo_endpoints
        if endpoint == timeout:
            if opcode == wire.WRITE:
                self.timeout = value
            return self.timeout
        if endpoint == enable:
            if opcode == wire.WRITE:
                self.is_on = bool(value[0])
            return bytes((self.is_on,))
        return None

    def save(self) -> None:
        """Store the present settings over power cycles."""
        (timeout,) = wire.UINT32.unpack(self.timeout)
        self._store.save({(0, 0): timeout, (0, 1): int(self.is_on)})

    def erase(self) -> None:
        """Restore the factory settings at the next start."""
        self._store.clear()
