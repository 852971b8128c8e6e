"""Masks of a robot's file, read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from robotctl.errors import ConfigError
from robotctl.maps.map_file import load_map
from robotctl.planning.map.mask import Mask
from robotctl.planning.map.mask_config import MaskConfig


def load_masks(masks: Sequence[MaskConfig], beside: Path) -> tuple[Mask, ...]:
    """Read the masks of a robot.

    Parameters
    ----------
    masks
        As its file has them.
    beside
        Folder of that file.

    Raises
    ------
    ConfigError
        If a file cannot be read, or its values mean nothing.
    """
    try:
        return tuple(Mask(each, load_map(beside / each.file)) for each in masks)
    except OSError as error:
        raise ConfigError(f"{error.filename}: {error.strerror}, as a mask of the robot") from error
    except ValueError as error:
        raise ConfigError(str(error)) from error
