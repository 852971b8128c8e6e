"""The electrical guards at their bounds: the last sample that passes, the first that does not."""

import math
from dataclasses import replace

import pytest

from firmware_sim.nodes.drive_guards import (
    ChannelGuard,
    ChannelSample,
    DriveFault,
    Limits,
    MotorModel,
    SupplyGuard,
)

MS = 1_000_000
MODEL = MotorModel(
    resistance_ohm=2.0, back_emf_v_s_rad=0.5, current_limit_a=10.0, counts_per_revolution=1000
)
LIMITS = Limits(current_a=8.0, temperature_c=90.0, voltage_v=9.0)
SUPPLY_V = 12.0
REST = ChannelSample(0.0, 0.0, 25.0, 0)


def test_faults_are_the_bits_of_the_wire() -> None:
    names = "OVER_CURRENT OVER_TEMPERATURE UNDER_VOLTAGE ENCODER COMMAND_TIMEOUT PARAMETER"
    assert [(fault.name, fault.value) for fault in DriveFault] == [
        (name, 1 << bit) for bit, name in enumerate(names.split())
    ]


def stands(guard: ChannelGuard, sample: ChannelSample, step_ns: int = MS) -> int:
    """For how many samples in a row the guard keeps still [up to 2000]."""
    for samples in range(2000):
        if guard.update(sample, SUPPLY_V, LIMITS, step_ns):
            return samples
    return 2000


@pytest.mark.parametrize(
    ("sample", "fault", "after_ms"),
    [
        (REST._replace(current_a=8.001), DriveFault.OVER_CURRENT, 500),
        (REST._replace(current_a=-8.001), DriveFault.OVER_CURRENT, 500),
        (REST._replace(temperature_c=90.1), DriveFault.OVER_TEMPERATURE, 10),
    ],
)
def test_a_condition_that_stands_is_a_fault_after_its_time_and_not_before(
    sample: ChannelSample, fault: DriveFault, after_ms: int
) -> None:
    guard = ChannelGuard(MODEL)
    # The first sample begins the count, so the time has passed with the sample after_ms later.
    assert stands(guard, sample) == after_ms
    assert guard.update(sample, SUPPLY_V, LIMITS, MS) == fault


@pytest.mark.parametrize(
    "sample",
    [
        REST._replace(current_a=8.0),
        REST._replace(current_a=-8.0),
        REST._replace(temperature_c=90.0),
    ],
)
def test_a_value_at_its_limit_is_no_fault(sample: ChannelSample) -> None:
    assert stands(ChannelGuard(MODEL), sample) == 2000


def test_one_good_sample_starts_the_count_anew() -> None:
    guard = ChannelGuard(MODEL)
    hot = REST._replace(temperature_c=95.0)
    for _ in range(20):
        for _ in range(10):
            assert guard.update(hot, SUPPLY_V, LIMITS, MS) == 0
        assert guard.update(REST, SUPPLY_V, LIMITS, MS) == 0


def test_the_time_counts_and_not_the_number_of_samples() -> None:
    guard = ChannelGuard(MODEL)
    hot = REST._replace(temperature_c=95.0)
    assert [guard.update(hot, SUPPLY_V, LIMITS, 4 * MS) for _ in range(4)] == [
        0, 0, 0, DriveFault.OVER_TEMPERATURE,
    ]  # fmt: skip


def test_a_fault_comes_to_the_nanosecond() -> None:
    guard = ChannelGuard(MODEL)
    hot = REST._replace(temperature_c=95.0)
    assert guard.update(hot, SUPPLY_V, LIMITS, MS) == 0
    assert guard.update(hot, SUPPLY_V, LIMITS, 10 * MS - 1) == 0
    assert guard.update(hot, SUPPLY_V, LIMITS, 1) == DriveFault.OVER_TEMPERATURE


def test_conditions_together_are_a_bit_each() -> None:
    guard = ChannelGuard(MODEL)
    bad = ChannelSample(0.0, 8.5, 95.0, 0)
    found = [guard.update(bad, SUPPLY_V, LIMITS, MS) for _ in range(501)]
    assert found[-1] == DriveFault.OVER_CURRENT | DriveFault.OVER_TEMPERATURE
    # Full duty without counts, of a winding that leaves 8 V of 12.
    guard = ChannelGuard(replace(MODEL, resistance_ohm=0.4))
    bad = bad._replace(duty=1.0)
    found = [guard.update(bad, SUPPLY_V, LIMITS, MS) for _ in range(501)]
    assert found[10] == DriveFault.OVER_TEMPERATURE
    assert found[201] == DriveFault.OVER_TEMPERATURE | DriveFault.ENCODER
    assert found[500] == (
        DriveFault.OVER_CURRENT | DriveFault.OVER_TEMPERATURE | DriveFault.ENCODER
    )


def turn(
    guard: ChannelGuard,
    electrical_rad_s: float,
    counts_per_sample: int,
    *,
    current_a: float = 0.0,
    temperature_c: float = 25.0,
    samples: int = 400,
) -> int | None:
    """Samples until an encoder fault of a motor with this back-EMF; None: none came."""
    warm = 1.0 + 0.0039 * (temperature_c - 25.0)
    duty = (electrical_rad_s * 0.5 + 2.0 * warm * current_a) / SUPPLY_V
    counts = 0
    for number in range(samples):
        sample = ChannelSample(duty, current_a, temperature_c, counts)
        faults = guard.update(sample, SUPPLY_V, LIMITS, MS)
        assert faults & ~DriveFault.ENCODER == 0
        if faults:
            return number
        counts += counts_per_sample
    return None


@pytest.mark.parametrize("sign", [1, -1])
def test_a_silent_encoder_is_found_after_200_ms_from_3_rad_s_on(sign: int) -> None:
    # The first sample has nothing to compare with, the second begins the count.
    assert turn(ChannelGuard(MODEL), sign * 3.001, 0) == 201
    assert turn(ChannelGuard(MODEL), sign * 2.999, 0) is None
    # An eighth of 12 V over 0.5 V s/rad is 3 rad/s to the bit.
    for duty, found in ((0.125, True), (math.nextafter(0.125, 0.0), False)):
        guard = ChannelGuard(MODEL)
        assert (stands(guard, ChannelSample(sign * duty, 0.0, 25.0, 0)) == 201) == found


@pytest.mark.parametrize("sign", [1, -1])
def test_an_encoder_that_counts_the_wrong_way_is_found_after_100_ms(sign: int) -> None:
    assert turn(ChannelGuard(MODEL), sign * 10.0, -sign) == 101
    assert turn(ChannelGuard(MODEL), sign * 10.0, sign) is None
    assert turn(ChannelGuard(MODEL), sign * 2.999, -sign) is None


@pytest.mark.parametrize("sign", [1, -1])
def test_a_slow_count_the_wrong_way_is_not_called_reversed(sign: int) -> None:
    """1 rad/s is the bound: one count of 1000 in 6.28 ms is below, in 6.2 ms above."""
    for step_ns, reversed_at in ((6_300_000, None), (6_200_000, 18)):
        guard = ChannelGuard(MODEL)
        duty = sign * 10.0 * 0.5 / SUPPLY_V
        found = None
        for number in range(60):
            sample = ChannelSample(duty, 0.0, 25.0, -sign * number)
            if found is None and guard.update(sample, SUPPLY_V, LIMITS, step_ns):
                found = number
        assert found == reversed_at


def test_1_rad_s_itself_is_not_called_reversed() -> None:
    """Over two years, the first time in which a count of 1000 comes to 1 rad/s to the bit."""
    for step_ns, found in ((62_831_853_071_795_864, 0), (62_831_853_071_000_000, 8)):
        guard = ChannelGuard(MODEL)
        for number in range(3):
            sample = ChannelSample(10.0 * 0.5 / SUPPLY_V, 0.0, 25.0, -number * 10**10)
            said = guard.update(sample, SUPPLY_V, LIMITS, step_ns)
        assert said == found


@pytest.mark.parametrize("temperature_c", [-10.0, 25.0, 80.0])
@pytest.mark.parametrize("current_a", [-6.0, 3.0, 7.9])
def test_the_drop_over_the_winding_at_its_temperature_is_no_speed(
    current_a: float, temperature_c: float
) -> None:
    """A stalled motor takes current and has no back-EMF: that is no fault of its encoder."""
    values = {"current_a": current_a, "temperature_c": temperature_c}
    assert turn(ChannelGuard(MODEL), 0.0, 0, **values) is None
    assert turn(ChannelGuard(MODEL), 2.99, 0, **values) is None
    assert turn(ChannelGuard(MODEL), 3.01, 0, **values) == 201


def test_the_encoder_is_not_judged_while_the_bridge_chops_or_does_not_drive() -> None:
    high = Limits(current_a=50.0, temperature_c=90.0, voltage_v=9.0)
    for duty, current_a, judged in ((0.9, 8.99, True), (0.9, 9.0, False), (-0.9, -9.0, False)):
        weak = MotorModel(0.1, 0.5, 10.0, 1000)
        guard = ChannelGuard(weak)
        sample = ChannelSample(duty, current_a, 25.0, 0)
        found = [guard.update(sample, SUPPLY_V, high, MS) for _ in range(300)]
        assert any(found) == judged
    guard = ChannelGuard(MODEL)
    # Braking by a short circuit: current against the motion, duty 0.
    braking = ChannelSample(0.0, -5.0, 25.0, 0)
    assert stands(guard, braking) == 2000


def test_samples_without_time_between_them_say_nothing_of_the_encoder() -> None:
    guard = ChannelGuard(MODEL)
    sample = ChannelSample(0.9, 0.0, 25.0, 0)
    for _ in range(300):
        assert guard.update(sample, SUPPLY_V, LIMITS, 0) == 0
        assert guard.update(sample, SUPPLY_V, LIMITS, -MS) == 0
    # One nanosecond is time.
    for _ in range(2):
        assert guard.update(sample, SUPPLY_V, LIMITS, 1) == 0
    assert guard.update(sample, SUPPLY_V, LIMITS, 200 * MS) == DriveFault.ENCODER


def test_reset_forgets_counts_and_what_stood() -> None:
    guard = ChannelGuard(MODEL)
    hot = REST._replace(temperature_c=95.0, current_a=9.0)
    for _ in range(10):
        guard.update(hot, SUPPLY_V, LIMITS, MS)
    guard.reset()
    assert stands(guard, hot) == 10
    guard.reset()
    assert turn(guard, 5.0, 0, samples=201) is None
    guard.reset()
    # A count that has jumped over the reset is no motion.
    assert turn(guard, 5.0, 0) == 201


@pytest.mark.parametrize(
    ("current_a", "temperature_c", "present"),
    [
        (8.0, 80.0, 0),
        (8.001, 80.0, DriveFault.OVER_CURRENT),
        (-8.001, 80.0, DriveFault.OVER_CURRENT),
        (0.0, 80.001, DriveFault.OVER_TEMPERATURE),
        (9.0, 85.0, DriveFault.OVER_CURRENT | DriveFault.OVER_TEMPERATURE),
    ],
)
def test_a_fault_can_be_cleared_when_its_cause_is_gone_by_the_hysteresis(
    current_a: float, temperature_c: float, present: int
) -> None:
    sample = ChannelSample(0.0, current_a, temperature_c, 0)
    assert ChannelGuard(MODEL).cause_present(sample, LIMITS) == present


def test_under_voltage_is_a_fault_after_50_ms_and_gone_0_2_v_above() -> None:
    guard = SupplyGuard()
    found = [guard.update(8.999, LIMITS, MS) for _ in range(52)]
    assert found == [0] * 50 + [DriveFault.UNDER_VOLTAGE] * 2
    assert guard.update(9.0, LIMITS, MS) == 0
    assert [guard.update(8.0, LIMITS, MS) for _ in range(50)] == [0] * 50
    guard.reset()
    assert [guard.update(8.0, LIMITS, MS) for _ in range(51)] == [0] * 50 + [
        DriveFault.UNDER_VOLTAGE
    ]
    assert guard.cause_present(math.nextafter(9.2, 0.0), LIMITS) == DriveFault.UNDER_VOLTAGE
    assert guard.cause_present(9.2, LIMITS) == 0
