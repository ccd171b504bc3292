"""Where something acts that no known effect explains."""
