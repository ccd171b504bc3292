"""The units that most files use, with Pint's own factors, so that they need no Pint.

Pint takes half a second to be ready, more than all the rest of checking a file. A unit that is not
in this table is left to Pint, and so are all complaints; a test holds every entry to Pint's answer.
"""

from __future__ import annotations

_BY_SI: dict[str, dict[str, float]] = {
    "": {"%": 0.01},
    "1/s": {"1/s": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0, "h": 3600.0},
    "Hz": {"Hz": 1.0, "kHz": 1e3, "mHz": 1e-3},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "m/s^2": {"m/s^2": 1.0},
    "m/s^3": {"m/s^3": 1.0},
    "m^2": {"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6},
    "m^3": {"m^3": 1.0, "cm^3": 1.0000000000000002e-06, "mm^3": 1e-9},
    "rad": {
        "rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295, "degree": 0.017453292519943295,
        "degrees": 0.017453292519943295, "°": 0.017453292519943295,
    },
    "rad/s": {"rad/s": 1.0, "deg/s": 0.017453292519943295, "rpm": 0.10471975511965977},
    "rad/s^2": {"rad/s^2": 1.0, "deg/s^2": 0.017453292519943295},
    "kg": {"kg": 1.0, "g": 1e-3},
    "N": {"N": 1.0, "kN": 1e3, "mN": 1e-3},
    "N*m": {"N*m": 1.0, "Nm": 1.0, "mN*m": 1e-3, "mNm": 1e-3, "kN*m": 1e3},
    "Pa": {
        "Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "mbar": 100.0, "bar": 1e5,
        "psi": 6894.7572931683635,
    },
    "A": {"A": 1.0, "mA": 1e-3},
    "V": {"V": 1.0, "mV": 1e-3},
    "W": {"W": 1.0, "kW": 1e3},
    "J": {"J": 1.0, "kJ": 1e3},
    "K": {"K": 1.0},
    "kg*m^2": {"kg*m^2": 1.0, "kg*cm^2": 1e-4, "g*cm^2": 1.0000000000000001e-07},
    "N*m/A": {"N*m/A": 1.0},
    "N*m*s/rad": {"N*m*s/rad": 1.0},
    "N*s/m": {"N*s/m": 1.0},
    "N/m": {"N/m": 1.0},
    "m^3/s": {"m^3/s": 1.0, "l/min": 1.666666666666667e-05},
    "m^3/rad": {
        "m^3/rad": 1.0, "cm^3/rev": 1.5915494309189538e-07,
        "cm^3/revolution": 1.5915494309189538e-07,
    },
    "m^3/(s*Pa)": {"m^3/(s*Pa)": 1.0},
    "A/Pa": {"A/Pa": 1.0, "A/MPa": 1e-6, "A/bar": 1e-5},
    "A/(Pa*s)": {"A/(Pa*s)": 1.0, "A/(MPa*s)": 1e-6},
    "A/rad": {"A/rad": 1.0, "A/deg": 57.29577951308232},
    "A*s/rad": {"A*s/rad": 1.0},
}  # fmt: skip

COMMON: dict[str, tuple[str, float, float]] = {
    "degC": ("K", 1.0, 273.15),
    "°C": ("K", 1.0, 273.15),
    **{unit: (si, factor, 0.0) for si, units in _BY_SI.items() for unit, factor in units.items()},
}
"""Unit -> (SI unit, factor, offset) with SI value = factor * value + offset."""

BASE = frozenset(
    {"", "s", "1/s", "Hz", "m", "m/s", "m/s^2", "m^2", "m^3", "rad", "rad/s", "rad/s^2", "kg",
     "N", "N*m", "Pa", "A", "V", "W", "K"}
)  # fmt: skip
"""SI units by which `base_unit` calls a kind."""
