"""Factor graphs: variables, factors, and both put together."""
