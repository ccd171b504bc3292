"""Position control by sliding mode with an inner speed loop, Eq. (12)-(20) of the paper.

With the corrections of the paper notes (the plant is of third order in x)::

    x''' = f + g u' + d,      u' = motor speed
    f = (1/M) { A S [-A x' - L (P1 - P2)] - B_a x'' },   g = A D S / M,   S = beta/V_1 + beta/V_2
    e = x - x_ref,   s = e'' + 2 c e' + c^2 e
    u' = (1/g) [ -f + x_ref''' - 2 c e'' - c^2 e' - k sat(s / phi) - epsilon s ]

sign(s) of Eq. (19) chatters at a finite tick rate; it is replaced by the saturation sat(s / phi)
with the boundary layer `phi` (Slotine, Li, Applied Nonlinear Control, 1991, section 7.2): inside
the layer the law is linear, and `s` stays within phi. x'' is not measured: it is taken from the
force balance, Eq. (6), with the measured pressures and velocity.

The reference of a step has no derivatives that a machine could follow, so x_ref and its derivatives
are those of the knee's reference passed through `profile`, a filter with bounded speed and
acceleration. The motor speed asked for goes to the inner PI loop, where it is limited.

Velocity and acceleration pass a first-order low-pass with the time constant `filter_time`, because
their noise is multiplied by the gains of the inner loop.

`trim` adds what removes the last error at rest, k_x * integral(e): dry friction holds the rod where
the boundary layer is too soft to move it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from eha_bench.control.controller import Context, Controller, clip
from eha_bench.control.profile import Profile, ProfileLimits
from eha_bench.control.speed_pi import SpeedGains, SpeedPI
from eha_bench.core.errors import InputError
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel


class DesignModel(StrictModel):
    """What the control law takes the plant to be; part of the controller's revision, SI."""

    pump_displacement: Annotated[float, Unit("m^3/rad"), Field(gt=0)]
    piston_area: Annotated[float, Unit("m^2"), Field(gt=0)]
    bulk_modulus: Annotated[float, Unit("Pa"), Field(gt=0)]
    volume: Annotated[float, Unit("m^3"), Field(gt=0)]
    leakage: Annotated[float, Unit("m^3/(s*Pa)"), Field(ge=0)]
    load_mass: Annotated[float, Unit("kg"), Field(gt=0)]
    rod_viscous: Annotated[float, Unit("N*s/m"), Field(ge=0)]


class SlidingModeGains(StrictModel):
    """Gains of Eq. (16)-(20) and of the inner speed loop, SI."""

    c: Annotated[float, Unit("1/s"), Field(gt=0, description="slope of the sliding surface")]
    k: Annotated[float, Unit("m/s^3"), Field(ge=0, description="reaching gain")]
    epsilon: Annotated[float, Unit("1/s"), Field(ge=0, description="proportional reaching rate")]
    phi: Annotated[float, Unit("m/s^2"), Field(gt=0, description="boundary layer")]
    filter_time: Annotated[
        float, Unit("s"), Field(ge=0, description="low-pass of velocity and acceleration")
    ] = 0.0
    trim: Annotated[float, Unit("1/s"), Field(ge=0, description="integral trim at rest")] = 0.0
    profile: ProfileLimits
    speed: SpeedGains
    model: DesignModel


class SlidingMode(Controller):
    """Sliding mode position control with an inner speed PI (Eq. (12)-(20))."""

    Gains = SlidingModeGains

    def __init__(self, gains: StrictModel, context: Context) -> None:
        assert isinstance(gains, SlidingModeGains)
        if context.linkage is None:
            raise InputError("sliding_mode needs a joint, and this target has none")
        self._gains = gains
        self._context = context
        self._linkage = context.linkage
        self._inner = SpeedPI(gains.speed, context)
        self._profile: Profile | None = None
        self._integral = 0.0
        self._velocity = 0.0
        self._acceleration = 0.0

    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        """Return the current for a joint angle reference in rad, A."""
        gains, plant = self._gains, self._gains.model
        x = reading["piston_position"]
        difference = reading["pressure_difference"]
        target = self._linkage.position_at(reference)
        if self._profile is None:
            self._profile = Profile(gains.profile, self._context.period, x)
        wanted = self._profile.step(target)
        area, mass = plant.piston_area, plant.load_mass
        stiffness = plant.bulk_modulus / max(plant.volume + area * x, 0.02 * plant.volume)
        stiffness += plant.bulk_modulus / max(plant.volume - area * x, 0.02 * plant.volume)
        share = self._context.period / (self._context.period + gains.filter_time)
        self._velocity += share * (reading["piston_velocity"] - self._velocity)
        v = self._velocity
        net = area * difference - plant.rod_viscous * v
        self._acceleration += share * (net / mass - self._acceleration)
        acceleration = self._acceleration
        f = area * stiffness * (-area * v - plant.leakage * difference) / mass
        f -= plant.rod_viscous * acceleration / mass
        g = area * plant.pump_displacement * stiffness / mass
        e, de, dde = x - wanted.x, v - wanted.v, acceleration - wanted.a
        s = dde + 2 * gains.c * de + gains.c**2 * e
        speed = (
            -f
            + wanted.jerk
            - 2 * gains.c * dde
            - gains.c**2 * de
            - gains.k * clip(s / gains.phi, 1.0)
            - gains.epsilon * s
        ) / g
        speed -= area / plant.pump_displacement * gains.trim * self._integral
        if abs(speed) <= gains.speed.speed_limit and not self._inner.saturated:
            self._integral += e * self._context.period * gains.c
        return self._inner.step(speed, reading)
