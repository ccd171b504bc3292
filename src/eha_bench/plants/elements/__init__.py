"""Kinds of elements, one a file: parameters, ports, and what each adds to its nodes' balances."""
