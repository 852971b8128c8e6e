"""How fast robotctl is, beside what else one would use. Not tests: no figure makes them fail."""
