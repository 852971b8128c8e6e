"""Files of factor graphs of all formats, recognised by content; written by suffix."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from robotctl.errors import ConfigError
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.graphs.g2o import G2O
from robotctl.logs.graphs.graph_format import GraphFile, GraphFormat
from robotctl.logs.graphs.gtsam_text import GTSAM
from robotctl.logs.graphs.information import judged
from robotctl.logs.graphs.toro import TORO
from robotctl.toml_source import nearest

GRAPH_FORMATS: Final[tuple[GraphFormat, ...]] = (
    G2O,
    GTSAM,  # before TORO: its files may have lines of TORO
    TORO,
)
"""All that is read; the first that matches reads. A new format is a file and a line here."""


def read_graph(path: Path, *, clip_indefinite: bool = False) -> GraphFile:
    """Read a graph.

    Parameters
    ----------
    path
        The file.
    clip_indefinite
        Whether negative eigenvalues of information matrices become 0; else they are refused.

    Raises
    ------
    ConfigError
        If there is no such file, or it is of no known format.
    GraphFormatError
        If a line is wrong.
    """
    if not path.is_file():
        there = [each.name for each in path.parent.glob("*")] if path.parent.is_dir() else []
        raise ConfigError(f"{path}: there is no such file{nearest(path.name, there)}")
    try:
        for each in GRAPH_FORMATS:
            if each.matches(path):
                return judged(path, each.read(path), clip=clip_indefinite)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from error
    except LogFormatError as error:
        raise ConfigError(str(error)) from error
    names = ", ".join(each.name for each in GRAPH_FORMATS)
    raise ConfigError(f"{path}: is no graph of a known format; known are {names}")


def format_of(path: Path) -> GraphFormat:
    """Return the format in which a file is to be written, by its suffix.

    Raises
    ------
    ConfigError
        If no format has it.
    """
    for each in GRAPH_FORMATS:
        if path.suffix.lower() == each.suffix:
            return each
    allowed = ", ".join(f"{each.suffix} ({each.name})" for each in GRAPH_FORMATS)
    raise ConfigError(f"{path}: the suffix says the format; allowed are {allowed}")
