"""Sensor models from recordings."""
