"""Landmarks: detection in scans, data association and localisation by them."""
