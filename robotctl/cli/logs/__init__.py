"""`robotctl record`, `replay` and `plot`."""
