"""Maps of places and passages, without coordinates."""
