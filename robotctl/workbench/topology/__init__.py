"""Topological maps: made of metric ones, named, and asked for a way."""
