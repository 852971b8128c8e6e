"""A PID controller holds a simulated gear motor at 10 rad/s, also against a load that comes on.

python examples/pid_on_a_motor.py
"""

from firmware_sim.config.parameters import MotorParameters
from firmware_sim.plant.motor import Motor
from robotctl.control import Pid, PidConfig

STEP_S, SUPPLY_V, SPEED_RAD_S = 0.001, 12.0, 10.0
motor = Motor(MotorParameters(), load_kg_m2=0.01, dt_s=STEP_S)
pid = Pid(PidConfig(kp=0.8, ki=6.0))
for load_n_m in (0.0, 0.5):
    for _ in range(1000):
        voltage_v = pid.step(SPEED_RAD_S, motor.speed_rad_s, STEP_S, 0.0, SUPPLY_V)
        motor.step(voltage_v, SUPPLY_V, load_n_m)
    print(f"load {load_n_m:.1f} N m: {motor.speed_rad_s:.2f} rad/s with {voltage_v:.2f} V")
