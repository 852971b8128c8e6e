"""What a MAVSDK program does with a rover: run by the Python that has MAVSDK, with URL and plan.

Prints a line of JSON for each step: its name, and what came of it.
"""

import json
import math
import sys
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry

PATIENT_S = 60.0
GLOBAL, WAYPOINT = 3, 16
E7 = 1e7
NEAR_DEG = 4e-6


def tell(name, value):
    print(json.dumps([name, value]), flush=True)


def done(name, action, *arguments):
    """Do a step; tell what it returned, or its error."""
    try:
        value = action(*arguments)
        tell(name, "done")
    except Exception as error:
        tell(name, str(error))
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


def main():
    url, plan = sys.argv[1], json.loads(sys.argv[2])
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(url)
    system = sdk.first_autopilot(PATIENT_S)
    tell("connect", "done" if system else "no autopilot")
    missions, action = MissionRaw(system), Action(system)
    telemetry, parameters = Telemetry(system), Param(system)

    def near(latitude_deg, longitude_deg):
        at = telemetry.position()
        return math.dist((at.latitude_deg, at.longitude_deg), (latitude_deg, longitude_deg)) < (
            NEAR_DEG
        )

    tell("armable", until(lambda: telemetry.health().is_armable))
    tell("position", until(lambda: near(*plan["home"])))
    everything = done("parameters", parameters.get_all_params)
    tell("how many", [len(everything.float_params), len(everything.int_params)])
    done("set", parameters.set_param_float, "CRUISE_SPEED", 0.35)
    tell("set to", round(parameters.get_param_float("CRUISE_SPEED"), 3))
    done("set whole", parameters.set_param_int, "SAF_ARM_MS", 1500)
    tell("set whole to", parameters.get_param_int("SAF_ARM_MS"))
    places = [plan["home"]] * plan["first"] + plan["places"]
    items = [
        MissionItem(
            seq, GLOBAL, WAYPOINT, int(seq == 0), 1, 0.0, 0.0, 0.0, 0.0,
            round(latitude_deg * E7), round(longitude_deg * E7), 0.0, 0,
        )
        for seq, (latitude_deg, longitude_deg) in enumerate(places)
    ]  # fmt: skip
    done("upload", missions.upload_mission, items)
    back = done("download", missions.download_mission)
    tell("downloaded", [[each.x, each.y] for each in back[plan["first"] :]])
    done("arm", action.arm)
    done("start", missions.start_mission)
    tell(
        "complete",
        until(lambda: (p := missions.mission_progress()).total > 0 and p.current >= p.total),
    )
    done("goto", action.goto_location, *plan["goto"], 0.0, math.nan)
    tell("there", until(lambda: near(*plan["goto"])))
    done("return", action.return_to_launch)
    tell("home", until(lambda: near(*plan["home"])))
    done("hold", action.hold)
    done("disarm", action.disarm)
    tell("disarmed", until(lambda: not telemetry.armed()))
    done("clear", missions.clear_mission)
    left = missions.download_mission()
    tell("left", len(left[plan["first"] :]))


main()
