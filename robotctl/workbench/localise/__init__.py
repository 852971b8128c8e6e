"""Localisation and mapping on recordings."""
