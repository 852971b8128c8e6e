"""Motor constants and gains from a recorded response."""
