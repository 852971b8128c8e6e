"""The verdict on a map, from figures of the run that made it."""
