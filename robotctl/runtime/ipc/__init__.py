"""Between processes: topics, heartbeats and locks."""
