"""Recognising places by what a camera sees: bags of visual words."""
