"""A linear drive with friction, in open loop or under its own position controller (EMPS)."""
