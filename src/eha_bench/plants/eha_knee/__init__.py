"""The electro-hydrostatic knee actuator of the paper, Eq. (1)-(10)."""
