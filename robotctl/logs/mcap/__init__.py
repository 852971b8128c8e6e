"""MCAP logs: records, schemas and scenes."""
