"""What happens offline behind a command."""
