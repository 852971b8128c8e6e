"""Formats of recordings: CARMEN, MRCLAM, LEGO, TUM and our own."""
