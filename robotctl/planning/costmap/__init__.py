"""What it costs to pass a cell."""
