"""Reactions to a goal: behaviours, journeys and missions."""
