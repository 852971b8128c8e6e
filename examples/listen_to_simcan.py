r"""The signals of a simulated robot, by python-can and cantools: no part of robotctl is needed.

In one terminal, then, when that says that it runs, in another:

    python -m firmware_sim --robot configs/diff_drive.toml --world configs/worlds/flat.toml \
        --bus simcan:demo
    python examples/listen_to_simcan.py demo
"""

import sys
from pathlib import Path

import can
import cantools

DBC = Path(__file__).parent.parent / "configs" / "robot.dbc"
FRAMES = 200

database = cantools.database.load_file(DBC)
channel = sys.argv[1] if len(sys.argv) == 2 else sys.exit(__doc__)
seen: dict[str, dict] = {}
with can.Bus(interface="simcan", channel=channel) as bus:
    bus.send(can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False))  # NMT: all start
    for _ in range(FRAMES):
        frame = bus.recv(timeout=5.0)
        if frame is None:
            sys.exit("nothing was heard for 5 s: does firmware_sim run on this channel?")
        try:
            message = database.get_message_by_frame_id(frame.arbitration_id)
        except KeyError:
            continue  # heartbeats and other services of CANopen
        seen[message.name] = message.decode(frame.data)
for name, signals in sorted(seen.items()):
    print(f"{name}: {', '.join(f'{key}={value}' for key, value in list(signals.items())[:4])}")
