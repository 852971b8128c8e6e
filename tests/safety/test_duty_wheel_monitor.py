"""One wheel's monitor and its tolerances, each bound from both sides."""

import math
from dataclasses import replace as changed

import pytest

from robotctl.safety.duty_wheel_monitor import DutyWheelMonitor
from robotctl.safety.persistence import PersistenceTimer
from robotctl.safety.plausibility_config import PlausibilityConfig
from tests.safety.exact_tolerances import CONFIG, MS, T0, above, below


@pytest.mark.parametrize(
    "name",
    [
        "resistance_ohm",
        "back_emf_v_s_rad",
        "speed_tolerance_rad_s",
        "speed_tolerance_share",
        "push_v",
        "pair_share",
        "steering_tolerance_rad",
        "clock_share",
        "travel_m",
    ],
)
def test_a_tolerance_is_a_finite_number_above_zero(name: str) -> None:
    smallest = math.ulp(0.0)
    assert getattr(changed(CONFIG, **{name: smallest}), name) == smallest
    for value in (0.0, -1.0, math.nan, math.inf):
        message = f"^{name}: {value} found, a finite number > 0 allowed$"
        with pytest.raises(ValueError, match=message):
            changed(CONFIG, **{name: value})


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("speed_tolerance_rad_s", 5.0),
        ("speed_tolerance_share", 0.5),
        ("push_v", 10.0),
        ("pair_share", 0.5),
        ("steering_tolerance_rad", 0.5),
        ("clock_share", 0.25),
        ("travel_m", 2.0),
    ],
)
def test_no_tolerance_can_be_set_so_wide_that_nothing_exceeds_it(name: str, most: float) -> None:
    assert getattr(changed(CONFIG, **{name: most}), name) == most
    with pytest.raises(ValueError, match=rf"^{name}: \S+ found, at most {most} allowed$"):
        changed(CONFIG, **{name: above(most)})


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("speed_ms", 5, 500),
        ("push_ms", 20, 2000),
        ("pair_ms", 20, 5000),
        ("steering_ms", 20, 2000),
        ("follow_ms", 50, 2000),
    ],
)
def test_no_time_can_be_set_away(name: str, low: int, high: int) -> None:
    for allowed in (low, high):
        assert getattr(changed(CONFIG, **{name: allowed}), name) == allowed
    for refused in (low - 1, high + 1):
        with pytest.raises(ValueError, match=f"^{name}: {refused} found, {low} to {high} allowed$"):
            changed(CONFIG, **{name: refused})


def test_a_condition_stands_since_it_first_stood_without_a_break() -> None:
    standing = PersistenceTimer()
    seen = [
        standing.lasts_ns(condition, now_ns)
        for condition, now_ns in [(True, 5), (True, 7), (True, 12), (False, 13), (True, 20)]
    ]
    assert seen == [0, 2, 7, 0, 0]
    assert standing.lasts_ns(True, 21) == 1


def wheel(
    counted_rad_s: float,
    electrical_rad_s: float,
    *,
    current_a: float = 0.0,
    off_ns: int = 50 * MS + 1,
    config: PlausibilityConfig = CONFIG,
) -> DutyWheelMonitor:
    """A wheel of which encoder and motor have said the same for so long."""
    monitor = DutyWheelMonitor("left", config, math.inf)
    voltage_v = electrical_rad_s * 0.5 + 2.0 * current_a
    for stamp_ns in (T0, T0 + off_ns):
        monitor.update(counted_rad_s, voltage_v, current_a, 25.0, stamp_ns)
    assert monitor.electrical_rad_s == electrical_rad_s
    return monitor


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("current_a", [-3.0, 0.0, 5.0])
@pytest.mark.parametrize("temperature_c", [-20.0, 25.0, 75.0])
def test_the_electrical_speed_is_that_of_the_back_emf_at_any_load_and_temperature(
    sign: float, current_a: float, temperature_c: float
) -> None:
    speed, resistance = sign * 10.0, 2.0 * (1.0 + 0.0039 * (temperature_c - 25.0))
    monitor = DutyWheelMonitor("left", CONFIG, math.inf)
    monitor.update(speed, resistance * current_a + 0.5 * speed, current_a, temperature_c, T0)
    assert monitor.electrical_rad_s == pytest.approx(speed)
    assert monitor.counted_rad_s == speed


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("counted", "off"),
    # 2 + a quarter of the greater of the two speeds, around 10 rad/s by the motor.
    [(5.5, False), (below(5.5), True), (16.0, False), (above(16.0), True)],
)
def test_the_two_speeds_may_lie_apart_by_the_tolerance_and_no_more(
    sign: float, counted: float, off: bool
) -> None:
    assert wheel(sign * counted, sign * 10.0).is_off == off
    assert bool(wheel(sign * counted, sign * 10.0).encoder_fault()) == off


@pytest.mark.parametrize(("electrical", "tolerance"), [(2.0, 4.0), (-8.0, 4.0), (-16.0, 6.0)])
def test_the_tolerance_grows_with_the_faster_of_the_two(
    electrical: float, tolerance: float
) -> None:
    assert wheel(8.0, electrical).tolerance_rad_s == tolerance
    assert wheel(-8.0, electrical).tolerance_rad_s == tolerance


@pytest.mark.parametrize(
    ("counted", "electrical", "share"),
    # Off by 8, 16 and 32 rad/s where 4, 4 and 6 are tolerated, 16 where 8 are.
    [(0.0, 8.0, 2.0), (8.0, -8.0, 4.0), (16.0, -16.0, 16.0 / 3.0), (24.0, 8.0, 2.0)],
)
def test_the_farther_an_encoder_is_off_the_sooner_it_is_and_not_before(
    counted: float, electrical: float, share: float
) -> None:
    limit_ns = 50 * MS / share
    for sign in (1.0, -1.0):
        before = wheel(sign * counted, sign * electrical, off_ns=math.floor(limit_ns))
        assert not before.is_off
        assert before.encoder_fault() is None
        assert wheel(sign * counted, sign * electrical, off_ns=math.floor(limit_ns) + 1).is_off


def test_an_encoder_that_is_hardly_off_has_its_whole_time() -> None:
    assert not wheel(above(16.0), 10.0, off_ns=50 * MS - 1).is_off
    assert wheel(above(16.0), 10.0, off_ns=50 * MS + 1).is_off


def test_how_far_it_is_off_counts_as_it_is_now() -> None:
    # 8 rad/s by the motor: off by twice the tolerance for 20 ms, then by 9/8 of it, 44.4 ms in all.
    monitor = DutyWheelMonitor("left", CONFIG, math.inf)
    for counted, at_ns, off in ((0, 0, False), (0, 20, False), (3.5, 44, False), (3.5, 45, True)):
        monitor.update(counted, 4.0, 0.0, 25.0, T0 + at_ns * MS)
        assert monitor.is_off == off


@pytest.mark.parametrize(
    ("counted", "electrical", "kind"),
    [
        (0.0, 10.0, "stuck or disconnected"),
        (0.25, -10.0, "stuck or disconnected"),
        (below(0.5), 10.0, "stuck or disconnected"),
        (-below(0.5), 10.0, "stuck or disconnected"),
        (0.5, 10.0, "wrong"),
        (-0.5, -10.0, "wrong"),
        (-0.5, 10.0, "reversed"),
        (10.0, -10.0, "reversed"),
        (10.0, 0.0, "wrong"),
        (10.0, 0.0625, "wrong"),
        (10.0, -0.0625, "reversed"),
    ],
)
def test_an_encoder_fault_is_named_by_what_it_looks_like(
    counted: float, electrical: float, kind: str
) -> None:
    assert str(wheel(counted, electrical).encoder_fault()) == (
        f"left encoder {kind}: {counted:.1f} rad/s counted, {electrical:.1f} rad/s by duty and "
        "current"
    )


def test_a_ratio_is_given_from_4_rad_s_on() -> None:
    assert wheel(2.0, 4.0).ratio == 0.5
    assert wheel(-3.0, -4.0).ratio == 0.75
    assert math.isnan(wheel(4.0, below(4.0)).ratio)
    assert math.isnan(wheel(4.0, -below(4.0)).ratio)


def test_a_narrow_tolerance_gives_the_ratio_from_twice_as_much_on_and_a_wide_one_no_later() -> None:
    narrow, wide = (changed(CONFIG, speed_tolerance_rad_s=value) for value in (0.5, 5.0))
    assert wheel(0.5, 1.0, config=narrow).ratio == 0.5
    assert math.isnan(wheel(0.5, below(1.0), config=narrow).ratio)
    assert wheel(2.0, 4.0, config=wide).ratio == 0.5


def push(
    counted: float,
    *,
    begin: float = 5.0,
    current_a: float = 1.0,
    lasts_ns: int = 300 * MS + 1,
    a_max_rad_s2: float = math.inf,
) -> str:
    """What is said of a wheel that turned at `begin` when the current came."""
    monitor = DutyWheelMonitor("left", CONFIG, a_max_rad_s2)
    for speed, now_ns in ((begin, T0), (counted, T0 + lasts_ns)):
        monitor.update(speed, 0.5 * speed + 2.0 * current_a, current_a, 25.0, now_ns)
        said = str(monitor.push_fault(now_ns) or "")
    return said


PUSHES = "left wheel pushes against something: 1.0 A, no faster"


def test_much_current_for_long_without_getting_faster_is_a_push() -> None:
    assert push(5.0) == PUSHES
    assert push(5.0, lasts_ns=300 * MS) == ""
    assert push(-5.0, begin=-5.0, current_a=-1.0) == PUSHES.replace("1.0 A", "-1.0 A")


def test_a_push_begins_above_the_voltage_over_the_winding() -> None:
    assert push(5.0, current_a=0.75) == ""
    assert push(5.0, current_a=-0.75) == ""
    assert push(5.0, current_a=above(0.75)).startswith("left wheel pushes")
    assert push(5.0, current_a=-above(0.75)).startswith("left wheel pushes")


@pytest.mark.parametrize("begin", [5.0, 0.0, -5.0, -8.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_gain_of_more_than_3_rad_s_along_the_push_meets_inertia(
    sign: float, begin: float
) -> None:
    """Whether it drives the wheel or brakes it."""
    for gain, held in ((0.0, True), (3.0, True), (3.001, False)):
        said = push(sign * (begin + gain), begin=sign * begin, current_a=sign)
        assert ("left wheel" in said) is held


@pytest.mark.parametrize(
    ("a_max_rad_s2", "enough"),
    # A third of what 0.3 s give, up to 3 rad/s.
    [(6.0, 0.6), (20.0, 2.0), (29.0, 2.9), (31.0, 3.0), (50.0, 3.0)],
)
def test_where_the_robot_may_not_get_faster_a_third_of_what_it_may_gain_meets_inertia(
    a_max_rad_s2: float, enough: float
) -> None:
    for gain, held in ((0.0, True), (0.999 * enough, True), (1.001 * enough, False)):
        assert bool(push(5.0 + gain, a_max_rad_s2=a_max_rad_s2)) is held
        assert bool(push(gain, begin=0.0, a_max_rad_s2=a_max_rad_s2)) is held


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_that_loses_its_speed_against_the_push_is_held(sign: float) -> None:
    """It was under way when something stopped it: that is no work of the current."""
    for speed in (4.0, 1.999, -5.0):
        assert "pushes against something" in push(sign * speed, begin=sign * 5.0, current_a=sign)
    assert "wheel is blocked" in push(0.0, begin=sign * 8.0, current_a=sign)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_push_the_other_way_is_another_push(sign: float) -> None:
    monitor = DutyWheelMonitor("left", CONFIG, math.inf)
    said = []
    for ms, current_a in ((0, 1.0), (299, 1.0), (300, -1.0), (600, -1.0), (601, -1.0)):
        monitor.update(0.0, 2.0 * sign * current_a, sign * current_a, 25.0, T0 + ms * MS)
        said.append(monitor.push_fault(T0 + ms * MS))
    assert [bool(text) for text in said] == [False, False, False, False, True]


def test_the_gain_is_counted_from_where_the_push_began() -> None:
    """And anew after each gain: a wheel that gets faster and faster is never stopped."""
    monitor = DutyWheelMonitor("left", CONFIG, math.inf)
    for number in range(400):
        # 5 ms, 0.06 rad/s: 3.6 rad/s in 300 ms.
        speed, now_ns = 0.06 * number, T0 + 5 * MS * number
        monitor.update(speed, 0.5 * speed + 2.0, 1.0, 25.0, now_ns)
        assert monitor.push_fault(now_ns) is None
    held = monitor.counted_rad_s
    for number in range(400, 600):
        now_ns = T0 + 5 * MS * number
        monitor.update(held, 0.5 * held + 2.0, 1.0, 25.0, now_ns)
        said = str(monitor.push_fault(now_ns) or "")
        # 372 began the time in which 28 gains were too few.
        if number <= 372 + 60:
            assert said == ""
    assert said == PUSHES


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_slower_than_half_a_rad_s_is_called_blocked(sign: float) -> None:
    blocked = "left wheel is blocked: 1.0 A and no motion"
    assert push(sign * below(0.5), begin=0.0) == blocked
    assert push(0.0, begin=0.0) == blocked
    assert push(sign * 0.5, begin=0.0) == PUSHES


def test_reset_forgets_speeds_and_what_stood() -> None:
    monitor = wheel(0.0, 10.0, current_a=2.0)
    monitor.push_fault(T0)
    monitor.reset()
    assert not monitor.is_off
    assert (monitor.counted_rad_s, monitor.electrical_rad_s) == (0.0, 0.0)
    assert monitor.encoder_fault() is None
    assert monitor.push_fault(T0 + 10_000 * MS) is None
    monitor.update(0.0, 5.0, 0.0, 25.0, T0 + 20_000 * MS)
    assert not monitor.is_off
