"""RPLIDARs of the A series over their serial line.

Protocol: Slamtec, "RPLIDAR interface protocol and application notes" (LR001). Used are the
requests STOP, RESET, GET_INFO, GET_HEALTH and SCAN, which all models know, and SET_PWM for the
motor of those that have their own; on an A1 the motor runs while DTR is low.

- A request is A5, its code, and for some a length, a payload and the xor of all bytes before.
- An answer begins with a descriptor: A5 5A, 30 bits of length and 2 of mode, little-endian, and
  the type of data.
- SCAN answers with 5 bytes a sample without end: quality (6 bits), not S and S, where S begins a
  revolution; the angle, clockwise, in 1/64 degree (15 bits) above a bit that is always 1; the
  distance in 1/4 mm (16 bits), 0 if nothing was measured.
"""

from __future__ import annotations

import contextlib
import itertools
import struct
import termios
from typing import Final, NamedTuple

import numpy as np
import serial

from robotctl.errors import LinkError
from robotctl.messages.lidar_port import LidarSweep
from robotctl.messages.ports import Clock

STOP: Final = b"\xa5\x25"
RESET: Final = b"\xa5\x40"
GET_INFO: Final = b"\xa5\x50"
GET_HEALTH: Final = b"\xa5\x52"
SCAN: Final = b"\xa5\x20"

_INFO: Final = (20, 0, 0x04)
_HEALTH: Final = (3, 0, 0x06)
_SAMPLES: Final = (5, 1, 0x81)
"""Descriptors of the answers: bytes, mode, type of data."""

_SAMPLE_BYTES: Final = 5
_PWM: Final = 660
"""Duty of the motor of an A2 or A3, out of 1023: the value that the maker's own software sets."""

_ANSWER_NS: Final = 1_000_000_000
_RESET_NS: Final = 2_000_000_000
_STOP_NS: Final = 20_000_000
"""Maximum times of an answer, a reset and a stop [ns]."""
_SILENT_NS: Final = 3_000_000_000
"""Time in which the motor of a lidar at rest gets up to speed [ns]."""
_READ_S: Final = 0.05
"""Maximum wait for data [s]."""
_MOST_SAMPLES: Final = 20_000
"""Maximum samples of a revolution; one without a beginning would fill the memory."""
_BROKEN: Final = 2
"""State of a lidar that reports a fault."""

_OPEN_ERRORS: Final = (OSError, ValueError, termios.error)
"""Errors of pyserial for absent, busy and unsuitable devices."""


class Samples(NamedTuple):
    """Samples in the order received, (n,) each."""

    begins: np.ndarray
    """Whether a revolution begins with it."""
    angles_rad: np.ndarray
    """Counter-clockwise [rad]."""
    ranges_m: np.ndarray
    """nan if nothing was measured [m]."""


class SampleReader:
    """Takes samples out of a stream of bytes, and finds its place again after damage."""

    def __init__(self) -> None:
        self._rest = b""
        self.skipped = 0
        """Bytes that were no part of a sample."""

    def feed(self, data: bytes) -> Samples:
        """Return the samples that are complete now."""
        data = self._rest + data
        good: list[bytes] = []
        at = 0
        while at + _SAMPLE_BYTES <= len(data):
            sample = data[at : at + _SAMPLE_BYTES]
            if _is_sample(sample):
                good.append(sample)
                at += _SAMPLE_BYTES
            else:
                at += 1
                self.skipped += 1
        self._rest = data[at:]
        raw = np.frombuffer(b"".join(good), np.uint8).reshape(-1, _SAMPLE_BYTES).astype(np.int64)
        angle = (raw[:, 1] >> 1) | (raw[:, 2] << 7)
        distance = raw[:, 3] | (raw[:, 4] << 8)
        ranges_m = np.where(distance > 0, distance / 4000.0, np.nan)
        return Samples((raw[:, 0] & 1) == 1, -np.radians(angle / 64.0), ranges_m)


def _is_sample(sample: bytes) -> bool:
    """Say whether the check bits fit: S and its opposite, and the bit that is always 1."""
    return (sample[0] ^ (sample[0] >> 1)) & 1 == 1 and sample[1] & 1 == 1


class Rplidar:
    """One RPLIDAR, turning from when it is opened.

    Parameters
    ----------
    device, baud
        Serial device and its speed.
    clock
        Stamps the samples.

    Raises
    ------
    LinkError
        If the device cannot be opened, does not answer as an RPLIDAR does, or reports a fault.
    """

    def __init__(self, device: str, baud: int, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        try:
            self._serial = serial.Serial(device, baud, timeout=_READ_S, exclusive=True)
        except _OPEN_ERRORS as error:
            raise LinkError(f"lidar: {device}: {error}") from error
        try:
            self._start()
        except BaseException:
            self.close()
            raise
        self._reader = SampleReader()
        self._heard_ns = clock.now_ns()
        self._sample_ns = 0.0
        """Time from sample to sample, by the last revolution [ns]."""
        self._parts: list[tuple[np.ndarray, Samples]] = []
        """Times and samples of the revolution under way; empty before the first one begins."""

    def read(self) -> LidarSweep | None:
        """Wait for data for a short time; return the last revolution that is complete now."""
        try:
            data = self._serial.read(max(1, self._serial.in_waiting))
        except _OPEN_ERRORS as error:
            raise LinkError(f"lidar: {self._device}: {error}") from error
        now_ns = self._clock.now_ns()
        samples = self._reader.feed(data)
        if len(samples.begins):
            self._heard_ns = now_ns
        elif now_ns - self._heard_ns > _SILENT_NS:
            raise LinkError(
                f"lidar: {self._device}: no samples for {_SILENT_NS / 1e9:g} s, and "
                f"{self._reader.skipped} invalid bytes; is baud right, and does it spin?"
            )
        return self._collect(samples, now_ns)

    def close(self) -> None:
        """Stop laser and motor and release the device."""
        with contextlib.suppress(*_OPEN_ERRORS):
            self._serial.write(STOP + _pwm(0))
            self._serial.flush()
            self._set_motor(on=False)
        self._serial.close()

    def _start(self) -> None:
        """Identify the lidar, check its health, and start scanning.

        Raises
        ------
        LinkError
            If it does not answer, or reports a fault that a reset does not end.
        """
        try:
            self._set_motor(on=True)
            self._stop()
            self._ask(GET_INFO, _INFO)
            if self._health()[0] == _BROKEN:
                self._serial.write(RESET)
                self._wait(_RESET_NS)
                self._serial.reset_input_buffer()
                status, code = self._health()
                if status == _BROKEN:
                    raise LinkError(
                        f"lidar: {self._device}: it reports a fault, code 0x{code:04X}, also after "
                        "a reset"
                    )
            self._serial.write(_pwm(_PWM))
            self._serial.write(SCAN)
            self._descriptor(SCAN, _SAMPLES)
        except _OPEN_ERRORS as error:
            raise LinkError(f"lidar: {self._device}: {error}") from error

    def _set_motor(self, *, on: bool) -> None:
        """Let the motor of an A1 run, where the device has the line for it: a pty has none."""
        with contextlib.suppress(*_OPEN_ERRORS):
            self._serial.dtr = not on

    def _stop(self) -> None:
        """End an earlier scan, and discard its data."""
        self._serial.write(STOP)
        self._serial.flush()
        self._wait(_STOP_NS)
        self._serial.reset_input_buffer()

    def _health(self) -> tuple[int, int]:
        """Return its state, 0 good, 1 warning, 2 fault, and the code of that."""
        status, code = struct.unpack("<BH", self._ask(GET_HEALTH, _HEALTH))
        return status, code

    def _ask(self, request: bytes, expected: tuple[int, int, int]) -> bytes:
        """Return the single answer to a request."""
        self._serial.write(request)
        self._descriptor(request, expected)
        return self._exactly(expected[0], request)

    def _descriptor(self, request: bytes, expected: tuple[int, int, int]) -> None:
        """Read the beginning of an answer."""
        head = self._exactly(7, request)
        word, kind = struct.unpack("<IB", head[2:])
        found = (word & 0x3FFF_FFFF, word >> 30, kind)
        if head[:2] != b"\xa5\x5a" or found != expected:
            raise LinkError(
                f"lidar: {self._device}: to {request.hex(' ')} it answered {head.hex(' ')}, which "
                "an RPLIDAR does not; is baud right?"
            )

    def _exactly(self, count: int, request: bytes) -> bytes:
        """Read a number of bytes of an answer."""
        end_ns = self._clock.now_ns() + _ANSWER_NS
        data = b""
        while len(data) < count:
            data += self._serial.read(count - len(data))
            if len(data) < count and self._clock.now_ns() > end_ns:
                raise LinkError(
                    f"lidar: {self._device}: {len(data)} of {count} bytes came in answer to "
                    f"{request.hex(' ')}; is it an RPLIDAR, powered, and is baud right?"
                )
        return data

    def _wait(self, duration_ns: int) -> None:
        """Wait."""
        self._clock.sleep_until(self._clock.now_ns() + duration_ns)

    def _collect(self, samples: Samples, now_ns: int) -> LidarSweep | None:
        """Add samples, the last of which has just come; return the newest full revolution."""
        count = len(samples.begins)
        stamps = now_ns - np.arange(count - 1, -1, -1) * self._sample_ns
        complete: LidarSweep | None = None
        edges = [0, *np.flatnonzero(samples.begins).tolist(), count]
        for first, last in itertools.pairwise(edges):
            part = Samples(*(each[first:last] for each in samples))
            if len(part.begins) == 0:
                continue
            if part.begins[0]:
                complete = self._sweep() or complete
                self._parts = []
            elif not self._parts:
                continue  # of a revolution of which the beginning is not known
            self._parts.append((stamps[first:last], part))
        if sum(len(part.begins) for _, part in self._parts) > _MOST_SAMPLES:
            self._parts = []
        return complete

    def _sweep(self) -> LidarSweep | None:
        """Return the revolution that has come to its end; None before the first has begun."""
        if not self._parts:
            return None
        stamps = np.concatenate([stamps for stamps, _ in self._parts])
        # Bytes arrive in bursts: delayed ones must not seem newer than later ones.
        stamps = np.minimum.accumulate(stamps[::-1])[::-1].astype(np.int64)
        self._sample_ns = (stamps[-1] - stamps[0]) / max(1, len(stamps) - 1)
        return LidarSweep(
            stamps,
            np.concatenate([part.angles_rad for _, part in self._parts]),
            np.concatenate([part.ranges_m for _, part in self._parts]),
        )


def _pwm(value: int) -> bytes:
    """Return the request to drive the motor, 0 to 1023."""
    request = b"\xa5\xf0\x02" + value.to_bytes(2, "little")
    checksum = 0
    for byte in request:
        checksum ^= byte
    return request + bytes((checksum,))
