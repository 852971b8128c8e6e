"""One file a microservice, all of them in `registry.SERVICES`."""
