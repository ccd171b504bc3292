"""A motor and its shaft with friction: the smallest machine that a current drives."""

SPINDLE = """\
plant: spindle
nodes:
  shaft: {kind: rotation, inertia: 9e-4 kg*m^2}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A, current_limit: 41 A}
  drag:  {kind: friction, on: shaft, coulomb: 0.16 N*m, viscous: 0.005 N*m*s/rad}
inputs:   {current_command: motor.current}
channels: {motor_speed: shaft.speed}
"""
