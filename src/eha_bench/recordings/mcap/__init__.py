"""MCAP files: scanned, read chunk by chunk, written."""
