"""What each kind of sensor gives to the localisers and the map."""
