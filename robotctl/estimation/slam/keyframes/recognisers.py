"""Recognisers that compare what scans saw around keyframes, by the name that a closure shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from robotctl.estimation.slam.keyframes.candidates import ScanRecogniser
from robotctl.estimation.slam.keyframes.shapes import Shapes
from robotctl.estimation.slam_config import SlamConfig

SCAN_RECOGNISERS: Final[Mapping[str, Callable[[SlamConfig], ScanRecogniser]]] = {
    "shape": lambda config: Shapes(config.shapes),
}
