"""Recognising places by their sonar signature."""
