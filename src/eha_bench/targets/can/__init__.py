"""A drive on a CAN bus as a target: all that is particular to it stands in a DBC and a YAML."""
