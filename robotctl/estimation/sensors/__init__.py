"""Measurements of each kind of sensor for the localisers and the map."""
