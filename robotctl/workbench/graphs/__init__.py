"""Factor graphs of files."""
