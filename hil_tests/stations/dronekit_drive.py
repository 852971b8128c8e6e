"""What a dronekit program does with a rover, run by its own Python: with URL and plan.

Prints a line of JSON for each step: its name, and what came of it.
"""

import collections
import collections.abc
import json
import math
import sys
import time

for name in ("MutableMapping", "Mapping", "Callable"):  # gone from Python 3.10 on
    setattr(collections, name, getattr(collections.abc, name))

from dronekit import Command, LocationGlobalRelative, VehicleMode, connect  # noqa: E402
from pymavlink import mavutil  # noqa: E402

PATIENT_S = 60.0
NEAR_DEG = 4e-6
GLOBAL, WAYPOINT = (
    mavutil.mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavutil.mavlink.MAV_CMD_NAV_WAYPOINT,
)


def tell(name, value):
    print(json.dumps([name, value]), flush=True)


def done(name, action, *arguments, **options):
    """Do a step; tell what came of it, or its error."""
    try:
        value = action(*arguments, **options)
        tell(name, "done")
    except Exception as error:
        tell(name, repr(error))
        return None
    return value


def until(condition):
    """Wait for something; return whether it came."""
    end_s = time.monotonic() + PATIENT_S
    while time.monotonic() < end_s:
        if condition():
            return True
        time.sleep(0.1)
    return False


def upload(robot, places):
    """Send a mission as dronekit's examples do: clear, add, upload."""
    commands = robot.commands
    commands.download()
    commands.wait_ready()
    commands.clear()
    for latitude_deg, longitude_deg in places:
        commands.add(
            Command(0, 0, 0, GLOBAL, WAYPOINT, 0, 0, 0, 0, 0, 0, latitude_deg, longitude_deg, 0.0)
        )
    commands.upload(timeout=20.0)


def download(robot):
    """Return the places that the robot has."""
    commands = robot.commands
    commands.download()
    commands.wait_ready()
    return [[each.x, each.y] for each in list(commands)]


def main():
    url, plan = sys.argv[1], json.loads(sys.argv[2])
    robot = done("connect", connect, url, wait_ready=True, timeout=60, heartbeat_timeout=60)

    def near(latitude_deg, longitude_deg):
        at = robot.location.global_frame
        if at.lat is None:
            return False
        return math.dist((at.lat, at.lon), (latitude_deg, longitude_deg)) < NEAR_DEG

    def become(mode):
        robot.mode = VehicleMode(mode)
        return until(lambda: robot.mode.name == mode)

    def arm(wanted):
        robot.armed = wanted
        return until(lambda: robot.armed == wanted)

    tell("armable", until(lambda: robot.is_armable))
    tell("ekf", robot.ekf_ok)
    tell("position", until(lambda: near(*plan["home"])))
    robot.parameters["CRUISE_SPEED"] = 0.35
    tell("set to", until(lambda: round(robot.parameters["CRUISE_SPEED"], 3) == 0.35))
    done("upload", upload, robot, plan["places"])
    tell("downloaded", [[round(value, 5) for value in each] for each in download(robot)])
    tell("mode AUTO", become("AUTO"))
    tell("arm", arm(True))
    last = len(plan["places"])
    tell("driven", until(lambda: robot.commands.next >= last and near(*plan["places"][-1])))
    tell("mode GUIDED", become("GUIDED"))
    done("goto", robot.simple_goto, LocationGlobalRelative(*plan["goto"], 0.0))
    tell("there", until(lambda: near(*plan["goto"])))
    tell("mode RTL", become("RTL"))
    tell("home", until(lambda: near(*plan["home"])))
    tell("disarm", arm(False))
    tell("mode HOLD", become("HOLD"))
    done("clear", upload, robot, [])
    tell("left", download(robot))
    robot.close()


main()
