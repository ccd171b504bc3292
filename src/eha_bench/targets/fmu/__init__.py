"""The target `fmu`: other people's plants, from Simulink, Modelica or any tool that exports FMI."""
