"""A node on the bus, as the host sees it: an entry of `CAN_NODES`."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from robotctl.drivers.can.codec import Decoder
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import Dbc
from robotctl.drivers.can.nodes.commissioning import Script
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig

Value: TypeAlias = object
"""Content of a frame: the type of its field in `Feedback`, or of an element of it."""


class FrameReader(Protocol):
    """Compiles decoders, at the start."""

    dbc: Dbc

    def decoder(self, message: str, *signals: str, raw: Collection[str] = ()) -> Decoder:
        """Return the decoder of some signals, those of `raw` unscaled."""


@dataclass(frozen=True, slots=True)
class NodeFrame:
    """A protected message of a node.

    Parameters
    ----------
    message
        Its name in the DBC.
    field
        Of `Feedback`: a field that is a tuple gets all values of a tick, another one the newest.
    reader
        Makes the function from data and time of reception [ns] to the value.
    """

    message: str
    field: str
    reader: Callable[[FrameReader], Callable[[bytes, int], Value]]


def _always(_: NodeParameters) -> bool:
    return True


@dataclass(frozen=True, slots=True)
class CanNode:
    """One kind of node.

    Parameters
    ----------
    node_id
        CANopen node id, 1 to 127.
    name
        Name shown to people; in capitals, its name in the DBC.
    script
        Makes its commissioning script.
    frames
        Its frames.
    ages
        How old the fields of `Feedback` that it fills may be, by the limits and the control
        period [ns].
    is_wanted
        Whether a robot has one.
    """

    node_id: int
    name: str
    script: Callable[[Dbc, NodeParameters], Callable[[], Script]]
    frames: tuple[NodeFrame, ...]
    ages: Callable[[SafetyConfig, int], tuple[AgeLimit, ...]]
    is_wanted: Callable[[NodeParameters], bool] = _always
