"""The signing key of the MAVLink links, and how far their time stamps are."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
from pathlib import Path
from typing import Final

import msgspec

from robotctl.config.options import StackOptions
from robotctl.drivers.mavlink.signing import KEY_SIZE, MINUTE, Memory, Signing
from robotctl.errors import ConfigError
from robotctl.mavlink.config import MavlinkConfig
from robotctl.runtime.storage.atomic_file import part_file
from robotctl.runtime.storage.state_file import StateError, StateFile

NAME: Final = "mavlink-signing.json"
SAVE_NS: Final = 30_000_000_000
"""Time stamps are saved so often [ns]; after a restart they go on a minute later."""
_HEX: Final = re.compile(r"[0-9a-fA-F]{64}")
_FEWEST_CHARACTERS: Final = 8


class SigningState(msgspec.Struct, frozen=True):
    """Time stamps of a key [10 us since 2015].

    `stamp` is the newest that was used, `last` the newest of each system, component and link, and
    `floor` that of those forgotten. They count for the key of which `key` names the first half of
    the hash.
    """

    stamp: int
    key: str = ""
    floor: int = 0
    last: tuple[tuple[tuple[int, int, int], int], ...] = ()


def read_key(path: Path) -> bytes:
    """Return the key of a file: 64 hexadecimal digits, or a pass phrase, whose SHA-256 it is.

    Raises
    ------
    ConfigError
        If it cannot be read, others may read it, or it holds no key.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode & 0o777
            text = file.read(4096).decode("utf-8").strip()
    except OSError as error:
        hint = f"; `robotctl mavlink keygen {path}` makes one"
        raise ConfigError(f"{path}: no signing key: {error.strerror}{hint}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: a signing key is a line of text") from error
    if mode & 0o077:
        raise ConfigError(f"{path}: mode {mode:04o} found, 0600 allowed: others could read the key")
    if _HEX.fullmatch(text):
        return bytes.fromhex(text)
    if len(text) < _FEWEST_CHARACTERS or "\n" in text:
        raise ConfigError(
            f"{path}: {len(text)} characters found; allowed is one line, of 64 hexadecimal digits "
            f"or a pass phrase of {_FEWEST_CHARACTERS} characters or more"
        )
    return hashlib.sha256(text.encode()).digest()


def configured_key(config: MavlinkConfig) -> bytes | None:
    """Return the key that a robot's file names, if there is one already.

    None where its file names none, or one that is still to come over a safe link.

    Raises
    ------
    ConfigError
        If the key cannot be read.
    """
    path = Path(config.signing_key) if config.signing_key else None
    if path is None or (any(link.safe for link in config.link) and not path.exists()):
        return None
    return read_key(path)


def write_new_key(path: Path) -> str:
    """Write a file with a new pass phrase, which only its owner may read; return the phrase.

    Raises
    ------
    ConfigError
        If there is such a file, or it cannot be written.
    """
    phrase = secrets.token_urlsafe(KEY_SIZE)
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise ConfigError(f"{path}: no key is written: {error.strerror}") from error
    with os.fdopen(descriptor, "w") as file:
        file.write(f"{phrase}\n")
    return phrase


class SigningFiles:
    """Signing as a robot's file sets it up, and what of it outlives a restart.

    Parameters
    ----------
    config
        Where the key lies; none: nothing is signed.
    options
        Where state lies.

    Attributes
    ----------
    signing
        For the links.

    Raises
    ------
    ConfigError
        If the key cannot be read. Where it may come over a safe link, its file may be missing;
        nobody has the key then.
    """

    def __init__(self, config: MavlinkConfig, options: StackOptions) -> None:
        self._path = Path(config.signing_key) if config.signing_key else None
        self._state = None
        self._saved_ns = 0
        self.signing = Signing()
        if self._path is None:
            return
        key = configured_key(config) or secrets.token_bytes(KEY_SIZE)
        saved = None
        if options.state:
            self._state = StateFile(Path(options.state) / NAME, SigningState)
            saved, _ = self._state.load()
        stamp, memory = 0, Memory()
        if saved is not None:
            stamp = saved.stamp + MINUTE
            if saved.key == _name(key):
                memory = Memory(saved.floor, saved.last)
        self.signing = Signing(key, stamp, memory=memory)

    def take_key(self, key: bytes, stamp: int) -> str:
        """Use and keep a key that came over a safe link; return why not, empty: it is used."""
        if self._path is None:
            return "the robot's file names no file for a key"
        if key == self.signing.key:
            return ""
        try:
            with part_file(self._path) as file:
                os.fchmod(file.fileno(), 0o600)
                file.write(f"{key.hex()}\n".encode())
        except OSError as error:
            return f"{self._path}: {error.strerror}"
        self.signing.take_key(key, stamp)
        return ""

    def save(self, now_ns: int) -> None:
        """Save the time stamps if it is time."""
        if now_ns - self._saved_ns >= SAVE_NS:
            self._saved_ns = now_ns
            self.close()

    def close(self) -> None:
        """Save the time stamps."""
        if self._state is not None and self.signing.key is not None:
            state = SigningState(self.signing.stamp, _name(self.signing.key), *self.signing.memory)
            try:
                self._state.save(state)
            except StateError:
                return  # the recorder says that the disk takes nothing


def _name(key: bytes) -> str:
    return hashlib.sha256(key).hexdigest()[:32]
