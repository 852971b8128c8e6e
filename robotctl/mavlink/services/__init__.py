"""One file a microservice."""
