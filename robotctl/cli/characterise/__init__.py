"""`robotctl characterise`."""
