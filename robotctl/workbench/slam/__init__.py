"""Maps and trajectories from recorded drives: the work behind `robotctl slam`."""
