"""The `robotctl` command."""
