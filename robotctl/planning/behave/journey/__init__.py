"""Journeys: to a goal, by plan and local controller, with recovery where the robot is stuck."""
