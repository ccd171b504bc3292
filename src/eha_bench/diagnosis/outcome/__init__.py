"""The verdict, and what is written of it."""
