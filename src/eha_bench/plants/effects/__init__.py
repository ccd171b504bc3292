"""Effects that a plant's declared equations may lack, one a file."""
