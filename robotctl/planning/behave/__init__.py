"""What to do about a goal: behaviours, journeys and missions."""
