"""The controller of docs/extending.md drives to a goal, round a box that is on no map."""

from robotctl.planning.behave.behaviours.behaviour import Status
from robotctl.planning.config import NavigationConfig, PilotConfig
from tests.planning.behave.journey.bench import Bench, room


def test_it_arrives_round_a_box():
    world = room()
    world[28:52, 55:63] = 100
    pilot = PilotConfig(controller="few_arcs")
    bench = Bench(world, room(), config=NavigationConfig(pilot=pilot))
    assert bench.drive(5.0, 2.0).status is Status.DONE
