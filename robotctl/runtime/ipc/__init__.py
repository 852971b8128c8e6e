"""Communication between processes: topics, heartbeats and locks."""
