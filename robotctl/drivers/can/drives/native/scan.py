"""Finds our own motor controller by its identity object."""

from __future__ import annotations

from dataclasses import replace

from robotctl.drivers.can.nodes.commissioning import Product
from robotctl.drivers.can.nodes.scan import CanopenProbe, Device, own_device
from robotctl.drivers.can.probe import Found


def native_probe() -> CanopenProbe:
    """Return the probe."""
    return CanopenProbe(_describe)


def _describe(device: Device) -> Found | None:
    found = own_device(device, {Product.MOTOR_CONTROLLER: "motor controller"})
    return None if found is None else replace(found, kind="native", axes=2)
