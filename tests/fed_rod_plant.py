"""A rod that a cylinder between reservoirs pushes against a spring, for tests."""

FED_ROD = """\
plant: fed
nodes:
  supply:  {kind: reservoir, pressure: 20 bar}
  ambient: {kind: reservoir, pressure: 0 bar}
  rod:     {kind: translation, mass: 2 kg}
elements:
  cylinder: {kind: cylinder, on: rod, a: supply, b: ambient, area_a: 5 cm^2, area_b: 5 cm^2}
  coil:     {kind: spring, on: rod, stiffness: 2e4 N/m}
  drag:     {kind: friction, on: rod, viscous: 200 N*s/m}
  push:     {kind: load, on: rod}
inputs: {push_force: push.force}
channels: {rod_position: rod.position}
calibrate: [supply.pressure, drag.viscous]
"""
