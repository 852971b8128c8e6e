"""Monte Carlo localisation."""
