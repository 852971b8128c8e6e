"""Who starts, watches, restarts and ends the processes."""
