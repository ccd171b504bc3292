"""The rig: a drive and its actuator behind a CAN adapter, played in real time on this machine."""
