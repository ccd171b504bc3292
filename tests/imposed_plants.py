"""Machines that nothing commands: a motion of one of their parts is imposed."""

PUMPED = """\
plant: pumped
nodes:
  shaft:     {kind: rotation}
  chamber_a: {kind: volume, bulk_modulus: 1.1 GPa}
  chamber_b: {kind: volume, bulk_modulus: 1.1 GPa}
  rod:       {kind: translation, mass: 50 kg, stroke: [-100 mm, 100 mm]}
elements:
  pump:     {kind: pump, on: shaft, from: chamber_b, to: chamber_a, displacement: 1 cm^3/rad}
  leak:     {kind: laminar_leakage, between: [chamber_a, chamber_b], conductance: 2e-12 m^3/(s*Pa)}
  cylinder: {kind: cylinder, on: rod, a: chamber_a, b: chamber_b, area_a: 12 cm^2, area_b: 12 cm^2,
             dead_volume_a: 50 cm^3, dead_volume_b: 50 cm^3}
  drag:     {kind: friction, on: rod, coulomb: 100 N, viscous: 2000 N*s/m}
channels: {motor_speed: shaft.speed, pressure_a: chamber_a.pressure, pressure_b: chamber_b.pressure,
           piston_position: rod.position}
"""
SEAL = """\
plant: seal
nodes:
  carriage: {kind: translation}
  rod:      {kind: translation, mass: 0.3 kg}
elements:
  cell: {kind: load_cell, between: [rod, carriage], stiffness: 4e4 N/m, damping: 50 N*s/m}
  seal: {kind: friction, on: rod, coulomb: 20 N, viscous: 100 N*s/m}
channels: {carriage_position: carriage.position, cell_force: cell.force}
"""
