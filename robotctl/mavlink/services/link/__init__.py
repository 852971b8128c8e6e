"""Stations on the links, and their requests."""
