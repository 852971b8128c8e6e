"""The faults after which the robot must stop, each with its limit."""

from __future__ import annotations

from dataclasses import dataclass

from robotctl.messages.faults import FaultCode as C

BRAKED_M, UNBRAKED_M = 0.05, 0.25
"""What a drive needs that shorts its motors, and one that has no supply or boots."""


@dataclass(frozen=True)
class Row:
    """One fault: its line, what the host says of it, and how soon the wheels are without power.

    Where several guards see a fault, it depends on the moment which is first: any of the causes,
    codes or codes with the part that is named.
    """

    fault: str
    causes: frozenset[C | tuple[C, str]]
    limit_ms: float
    omega_rad_s: float = 0.8
    rests_within_m: float = BRAKED_M
    """The way from then on, from 0.4 m/s."""
    last_true: int | None = None
    """Of which identifier one more frame is true: with that, which is repeated then, it begins."""
    cut_off: bool = False
    """Whether host and drive do not hear each other, so that each must stop by itself."""

    @property
    def name(self) -> str:
        """The fault without its duration."""
        return self.fault.partition(" duration=")[0]

    def explains(self, code: C, part: str) -> bool:
        """Return whether the host may say this of the fault."""
        return code in self.causes or (code, part) in self.causes

    @property
    def duration_s(self) -> float:
        """How long it lasts."""
        return float(self.fault.partition(" duration=")[2] or 0.0)


SILENT = frozenset({C.WHEELS_STALE})
STOPPED = frozenset({C.DRIVE_STOPPED})
BUS_BROKEN = frozenset({C.BUS_OFF, C.BUS_DOWN, C.BUS_PASSIVE, C.BUS_ERRORS})
BUS_FULL = frozenset({C.BUS_BLOCKED, C.BUS_SILENT})
"""Nothing comes; that nothing goes either shows only when the queue is full."""
NODE_GONE = (
    *(C.NODE_SILENT, C.NODE_STARTING, C.NODE_REFUSED, C.NODE_NO_ANSWER),
    *(C.NODE_PUT_OUT, C.NODE_RESTARTED),
)
DRIVE_GONE = SILENT | {(code, "drive") for code in NODE_GONE}
DRIVE_BOOTS = DRIVE_GONE | {C.DRIVE_UNDER_VOLTAGE}
WRONG = DRIVE_BOOTS | {(C.NODE_OTHER_FIRMWARE, "drive")}
NO_RANGE = frozenset({C.SONAR_STALE})
LEFT_ENCODER = frozenset(
    (code, "left") for code in (C.ENCODER_STUCK, C.ENCODER_REVERSED, C.ENCODER_WRONG)
)


def only(code: C, part: str = "") -> frozenset[C | tuple[C, str]]:
    """Return the one cause."""
    return frozenset({(code, part) if part else code})


ROWS = (
    Row("node_reset node=drive", DRIVE_GONE, 100, rests_within_m=UNBRAKED_M),
    Row("node_reset node=power", only(C.NODE_RESTARTED, "power"), 500),
    Row("node_silent node=drive duration=0.5", SILENT, 80),
    Row("node_silent node=sonar duration=1", NO_RANGE | {(C.NODE_SILENT, "sonar")}, 600),
    Row("feedback_lost duration=0.5", SILENT, 80),
    Row("feedback_frozen duration=0.5", only(C.ENCODER_STUCK), 600),
    Row("encoder_stuck wheel=right duration=0.5", only(C.ENCODER_STUCK, "right"), 600),
    Row("encoder_reversed wheel=left duration=0.5", only(C.ENCODER_REVERSED, "left"), 600),
    # It counts noise: nothing, backwards, or too little.
    Row("encoder_disconnected wheel=left duration=0.5", LEFT_ENCODER, 600),
    Row(
        "wheel_blocked wheel=left duration=0.5",
        frozenset({(C.WHEEL_BLOCKED, "left"), C.DRIVE_OVER_CURRENT}),
        600,
    ),
    # Its share of the voltage leaves a motor nothing to turn forwards with.
    Row(
        "over_current amperes=30 duration=0.5",
        frozenset({C.ENCODER_REVERSED, C.DRIVE_OVER_CURRENT}),
        400,
    ),
    Row("over_temperature kelvin=150 duration=0.5", only(C.DRIVE_OVER_TEMPERATURE), 400),
    Row("under_voltage volts=6 duration=0.5", only(C.DRIVE_UNDER_VOLTAGE), 400),
    Row(
        "brown_out volts=4 duration=0.5",
        only(C.DRIVE_UNDER_VOLTAGE, "drive"),
        400,
        rests_within_m=UNBRAKED_M,
    ),
    Row("brown_out volts=8 duration=0.5", only(C.DRIVE_UNDER_VOLTAGE, "drive"), 400),
    Row("parameter_lost node=drive", DRIVE_BOOTS, 100, rests_within_m=UNBRAKED_M),
    # Each setting is read once in 0.7 s, twice where it differs.
    Row("parameter_changed value=2000", only(C.NODE_CHANGED, "drive"), 850),
    Row(
        "parameter_changed parameter=current_limit value=60000", only(C.NODE_CHANGED, "drive"), 850
    ),
    Row("parameter_changed parameter=ring_period value=240", only(C.NODE_CHANGED, "sonar"), 400),
    Row("parameter_changed parameter=battery_critical value=1", only(C.NODE_CHANGED, "power"), 450),
    Row("wrong_firmware node=drive duration=0.5", WRONG, 100, rests_within_m=UNBRAKED_M),
    Row("clock_drift node=drive ppm=100000 duration=5", only(C.CLOCK_DRIFT), 4500),
    Row("sonar_silent duration=0.5", NO_RANGE, 400),
    # A comparison takes 0.3 m; the fault may have to wait for the end of the one it began in.
    # Where the range that sticks was an outlier, an obstacle there would have been reached.
    Row("sonar_stuck duration=3", frozenset({C.SONAR_STUCK, C.WHEELS_SLIP}), 1700, omega_rad_s=0.0),
    # Until it is found out each wheel is driven by the other's error: twice the turn rate.
    Row(
        "wheels_swapped duration=0.5",
        frozenset({C.ENCODERS_SWAPPED, C.ENCODER_WRONG}),
        600,
        omega_rad_s=0.5,
    ),
    Row("node_cut node=drive duration=0.5", DRIVE_GONE, 100, cut_off=True),
    Row("node_bus_off node=drive duration=0.5", BUS_BROKEN, 100),
    Row("host_cut duration=0.5", BUS_BROKEN, 100, cut_off=True),
    Row("host_bus_off duration=0.5", BUS_BROKEN, 100, cut_off=True),
    Row("no_ack duration=0.5", BUS_BROKEN, 100, cut_off=True),
    Row("overload priority=high load=1 duration=0.5", BUS_FULL, 100, cut_off=True),
    Row("bus_cut duration=0.5", BUS_BROKEN, 100, cut_off=True),
    Row("bus_short duration=0.5", BUS_BROKEN, 100, cut_off=True),
    Row("babble node=sonar duration=0.5", only(C.BUS_STRANGER, "NmtControl"), 100, cut_off=True),
    Row("masquerade duration=0.5", only(C.BUS_STRANGER, "MotorCommand"), 100),
    Row("frames_destroyed duration=0.5", BUS_BROKEN, 100, cut_off=True),
    Row("frames_lost id=0x181 duration=0.5", SILENT, 80),
    Row("frames_lost id=0x201 duration=0.5", STOPPED, 100),
    Row("frames_stale id=0x181 duration=0.5", SILENT, 80, last_true=0x181),
    Row("frames_stale id=0x201 duration=0.5", STOPPED, 100, last_true=0x201),
    Row("frames_corrupt id=0x181 duration=0.5", SILENT, 80),
    Row("frames_corrupt id=0x201 duration=0.5", STOPPED, 100),
    Row("frames_late id=0x181 delay=0.2 duration=0.5", SILENT, 80),
)
