"""Controllers: from a reference and what the sensors read to a command, once a tick."""
