"""Recordings on request, and the state of the recorder."""

from __future__ import annotations

import msgspec


class SetRecording(msgspec.Struct, frozen=True, tag=True):
    """Start a recording in the folder of `--record`, or stop the present one."""

    stamp_ns: int
    on: bool


class RecorderState(msgspec.Struct, frozen=True, tag=True):
    """State of the recorder, published once a second.

    `folder` is that of the recordings, empty: the robot was started without one. `trouble` is the
    reason why nothing is written while recording. `free_bytes` are left on the disk, None: unknown.
    """

    stamp_ns: int
    folder: str
    is_recording: bool
    trouble: str
    free_bytes: int | None
