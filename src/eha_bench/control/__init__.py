"""Controllers: from a reference and what the sensors read to a motor current, once a tick."""
