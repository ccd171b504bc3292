"""The signals that a suite can ask for: one a file, each found by its entry point."""
