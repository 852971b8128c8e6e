"""The way through a known map: planners that take a cost map and give a path, or a reason."""
