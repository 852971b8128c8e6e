"""Checking and running missions."""
