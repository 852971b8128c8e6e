"""`robotctl topology`."""
