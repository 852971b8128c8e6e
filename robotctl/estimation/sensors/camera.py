"""The camera: ranges to what stands on the floor, by the boundary of the floor in the picture."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from robotctl.estimation.ranging.likelihood_field import LikelihoodField
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.ranging.scan_messages import camera_scan
from robotctl.estimation.sensor_names import CAMERA
from robotctl.estimation.sensors.lidar import REHEARSED, scan_update
from robotctl.estimation.sensors.sensor import (
    CellUpdate,
    Listener,
    SensedMap,
    SensedRobot,
    Sensor,
)
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import CameraView, SensorMessage
from robotctl.model.sensors.range_scan import RangeScan

_VAGUE_M: Final = 0.5
"""Ranges of a camera are seldom less sure [m]."""


def _listen(message: ControlState | SensorMessage) -> Sequence[RangeScan]:
    if isinstance(message, CameraView) and not message.trouble:
        return (camera_scan(message),)
    return ()


def _listener(_: SensedRobot) -> Listener[RangeScan]:
    return _listen


def _likelihood(world_map: SensedMap, robot: SensedRobot) -> Callable[[RangeScan], LogLikelihood]:
    return LikelihoodField(world_map.grid, robot.settings.camera).measurement


def _rehearsal(robot: SensedRobot) -> RangeScan | None:
    # Vague ranges, so that the fields for them are made now.
    sigmas = np.full(len(REHEARSED.ranges_m), _VAGUE_M)
    return replace(REHEARSED, sigmas_m=sigmas) if robot.has_camera else None


def _cells(view: RangeScan, robot: SensedRobot) -> Iterator[tuple[Hashable, CellUpdate]]:
    yield CAMERA, scan_update(_sure(view, robot.settings.grid.camera_sigma_m))


def _sure(view: RangeScan, most_m: float) -> RangeScan:
    """Return a view without the ranges that are too vague for a cell."""
    if view.sigmas_m is None:
        return view
    ranges = np.where(view.sigmas_m <= most_m, view.ranges_m, np.nan)
    return replace(view, ranges_m=np.where(np.isinf(view.ranges_m), np.inf, ranges))


SENSOR: Final = Sensor(_listener, _likelihood, _rehearsal, lambda _: CAMERA, cells=_cells)
