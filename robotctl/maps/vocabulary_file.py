"""The file of a vocabulary of visual words: NumPy arrays (.npz)."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.config.robot_file import config_directory
from robotctl.errors import ConfigError, InvalidValue
from robotctl.estimation.places.visual.vocabulary import Vocabulary
from robotctl.runtime.storage.atomic_file import write_whole

_ARRAYS: Final = ("centres", "first", "idf")


def shipped_vocabulary() -> Path:
    """Return the file of the built-in vocabulary."""
    return config_directory() / "places" / "vocabulary.npz"


def load_vocabulary(path: Path) -> Vocabulary:
    """Read a vocabulary.

    Raises
    ------
    ConfigError
        If it is missing or damaged.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            missing = [name for name in _ARRAYS if name not in file]
            if missing:
                raise ConfigError(f"{path}: no vocabulary: no {missing[0]} in it")
            centres, first, idf = (file[name] for name in _ARRAYS)
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: no such file") from error
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{path}: no vocabulary: {error}") from error
    if centres.dtype != np.uint64 or centres.ndim != 2 or first.ndim != 1 or idf.ndim != 1:
        raise ConfigError(f"{path}: no vocabulary: arrays of another kind or shape")
    try:
        return Vocabulary(centres, first.astype(np.int64), idf.astype(np.float64))
    except InvalidValue as error:
        raise ConfigError(f"{path}: no vocabulary: {error}") from error


def save_vocabulary(vocabulary: Vocabulary, path: Path) -> None:
    """Write a vocabulary, atomically and reproducibly to the byte.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    content = io.BytesIO()
    np.savez(
        content,
        centres=vocabulary.centres,
        first=vocabulary.first.astype(np.int32),
        idf=vocabulary.idf.astype(np.float32),
    )
    write_whole(path, content.getvalue())
