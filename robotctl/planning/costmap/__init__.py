"""Cost of passing a cell."""
