"""Steps of the guided first day; `registry` has their order."""
