"""Plants as networks: nodes that hold state, elements between them, compiled to one kernel."""
