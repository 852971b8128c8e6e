"""Steps of the guided set-up; `registry` has their order."""
