r"""A robot on a CAN bus turns its wheels by a quarter of full power; here a simulated one.

In one terminal, then, when that says that it runs, in another:

    python -m firmware_sim --robot configs/diff_drive.toml --world configs/worlds/flat.toml \
        --bus simcan:demo
    python examples/drive_on_can.py demo
"""

import sys
import time
from pathlib import Path

from robotctl.app import make_robot
from robotctl.config import load_robot
from robotctl.messages import ActuatorCommand
from robotctl.runtime import RealClock

channel = sys.argv[1] if len(sys.argv) == 2 else sys.exit(__doc__)
bus = ("can.interface=simcan", f"can.channel={channel}")
clock, config = RealClock(), load_robot(Path("configs/diff_drive.toml"), bus)
robot = make_robot(config, clock)
for tick in range(300):
    feedback = robot.receive(clock.now_ns())
    command = ActuatorCommand(enable=tick > 100, values=(0.25, 0.25))
    robot.send(command, clock.now_ns())
    time.sleep(0.01)  # a drive that hears nothing for longer than its time-out stops by itself
robot.close()
for name, wheel in zip(config.drive.wheel_names, feedback.actuators, strict=False):
    print(f"{name}: {wheel.state.name.lower()}, at {wheel.position_ticks} ticks")
