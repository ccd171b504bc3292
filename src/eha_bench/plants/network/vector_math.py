"""Mathematical functions that LLVM can turn into vector instructions: no branches and no calls.

Laws of elements call `math.exp` and its like, and a call into the C library keeps a loop over
parameter sets from being vectorised. `vectorised_law` returns a law whose `math` is this module.
Each of its functions is within a few units of the last place of the C library's; outside the range
that it is written for it returns NaN, and the step is then done by the scalar kernel.

Reductions and polynomials: Cody, Waite, Software Manual for the Elementary Functions, Prentice Hall
1980; Muller, Elementary Functions, 3rd ed., Birkhäuser 2016, chapters 3 and 11.
"""

from __future__ import annotations

import dis
import math
from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from eha_bench.plants.compiled import Compiled, njit

pi, e, tau, inf, nan = math.pi, math.e, math.tau, math.inf, math.nan
sqrt, fabs, copysign = math.sqrt, math.fabs, math.copysign

_WORD = ir.IntType(64)


def _on_bits(change: Callable[[Any, Any], Any]) -> Callable[[float], float]:
    """Return a function of a number that changes its bits, as compiled code calls it.

    Args:
        change: called with LLVM's builder and the number's 64 bits; returns those of the result.
    """

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        bits = change(builder, builder.bitcast(arguments[0], _WORD))
        return builder.bitcast(bits, ir.DoubleType())

    def typing(context: Any, x: Any) -> Any:
        return types.float64(types.float64), generate

    made: Any = intrinsic(typing)  # its type outside compiled code is another
    return cast("Callable[[float], float]", made)


@_on_bits
def _power_of_two(builder: Any, bits: Any) -> Any:
    """2^k of k + 1.5 * 2^52: k stands in the last bits of that number."""
    return builder.shl(builder.add(bits, ir.Constant(_WORD, 1023)), ir.Constant(_WORD, 52))


@_on_bits
def _mantissa(builder: Any, bits: Any) -> Any:
    """The m of x = m * 2^k with m from 1 to 2, for x > 0 that is not subnormal."""
    bits = builder.and_(bits, ir.Constant(_WORD, 0x000FFFFFFFFFFFFF))
    return builder.or_(bits, ir.Constant(_WORD, 0x3FF0000000000000))


@_on_bits
def _shifted_exponent(builder: Any, bits: Any) -> Any:
    """2^52 + 1023 + k of x = m * 2^k: a whole number in the last bits needs no conversion."""
    bits = builder.lshr(bits, ir.Constant(_WORD, 52))
    return builder.or_(bits, ir.Constant(_WORD, 0x4330000000000000))


@njit(forceinline=True)
def _exponent(x: float) -> float:
    """The k of x = m * 2^k with m from 1 to 2, for x > 0 that is not subnormal."""
    return _shifted_exponent(x) - (4503599627370496.0 + 1023.0)


@njit(forceinline=True, fastmath={"contract"})
def exp(x: float) -> float:
    """e^x: reduced to |r| < ln(2) / 2, Taylor's polynomial; NaN above 708."""
    x = -708.0 if x < -708.0 else x
    shifted = x * 1.4426950408889634 + 6755399441055744.0
    k = shifted - 6755399441055744.0
    r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10
    p = 1.6059043836821613e-10
    p = p * r + 2.0876756987868100e-09
    p = p * r + 2.5052108385441720e-08
    p = p * r + 2.7557319223985893e-07
    p = p * r + 2.7557319223985888e-06
    p = p * r + 2.4801587301587302e-05
    p = p * r + 1.9841269841269841e-04
    p = p * r + 1.3888888888888889e-03
    p = p * r + 8.3333333333333332e-03
    p = p * r + 4.1666666666666664e-02
    p = p * r + 1.6666666666666666e-01
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    value = p * _power_of_two(shifted)
    return value if x <= 708.0 else math.nan


@njit(forceinline=True, fastmath={"contract"})
def log(x: float) -> float:
    """ln(x): x = m 2^k with m near 1, 2 artanh((m - 1) / (m + 1)); NaN for no positive number."""
    m, k = _mantissa(x), _exponent(x)
    high = m > 1.4142135623730951
    m = 0.5 * m if high else m
    k = k + 1.0 if high else k
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    p = 1.0 / 23.0
    p = p * z + 1.0 / 21.0
    p = p * z + 1.0 / 19.0
    p = p * z + 1.0 / 17.0
    p = p * z + 1.0 / 15.0
    p = p * z + 1.0 / 13.0
    p = p * z + 1.0 / 11.0
    p = p * z + 1.0 / 9.0
    p = p * z + 1.0 / 7.0
    p = p * z + 0.2
    p = p * z + 1.0 / 3.0
    value = k * 6.93147180369123816490e-01 + (
        2.0 * s + (2.0 * s * z * p + k * 1.90821492927058770002e-10)
    )
    return value if (x >= 2.3e-308) & (x <= 1.7e308) else math.nan


@njit(forceinline=True, fastmath={"contract"})
def pow(x: float, y: float) -> float:  # noqa: A001 - as `math` names it
    """x^y = e^(y ln x) for x > 0; NaN for other x."""
    return exp(y * log(x))


@njit(forceinline=True, fastmath={"contract"})
def tanh(x: float) -> float:
    """The hyperbolic tangent: its continued fraction near 0, exponentials further away."""
    z = x * x
    # Lambert's continued fraction, x / (1 + z / (3 + z / (5 + ...))), as one division
    a, b = 2027025.0 + z * (270270.0 + z * (6930.0 + z * 36.0)), 0.0
    b = 2027025.0 + z * (945945.0 + z * (51975.0 + z * (630.0 + z)))
    near = x * a / b
    far = -2.0 / (exp(2.0 * min(abs(x), 20.0)) + 1.0) + 1.0
    far = far if x > 0.0 else -far
    return near if z < 0.16 else (far if abs(x) >= 0.0 else math.nan)


@njit(forceinline=True, fastmath={"contract"})
def _shifted_sine(x: float, by: float) -> float:
    """sin(x + by * pi / 2) of a whole number `by`; NaN beyond the largest angle."""
    shifted = x * 0.6366197723675814 + 6755399441055744.0
    k = shifted - 6755399441055744.0
    r = ((x - k * 1.57079632673412561417e00) - k * 6.07710050630396597660e-11) - (
        k * 2.02226624879595063154e-21
    )
    k = k + by
    quarter = k * 0.25 - 0.375
    k = k - 4.0 * ((quarter + 6755399441055744.0) - 6755399441055744.0)
    z = r * r
    s = -7.6471637318198164e-13
    s = s * z + 1.6059043836821613e-10
    s = s * z - 2.5052108385441720e-08
    s = s * z + 2.7557319223985893e-06
    s = s * z - 1.9841269841269841e-04
    s = s * z + 8.3333333333333332e-03
    s = s * z - 1.6666666666666666e-01
    sine = r + r * z * s
    c = 4.7794773323873853e-14
    c = c * z - 1.1470745597729725e-11
    c = c * z + 2.0876756987868100e-09
    c = c * z - 2.7557319223985888e-07
    c = c * z + 2.4801587301587302e-05
    c = c * z - 1.3888888888888889e-03
    c = c * z + 4.1666666666666664e-02
    cosine = 1.0 - (0.5 * z - z * z * c)
    value = cosine if (k == 1.0) | (k == 3.0) else sine
    value = -value if k >= 2.0 else value
    return value if abs(x) <= 1e5 else math.nan


@njit(forceinline=True, fastmath={"contract"})
def sin(x: float) -> float:
    """The sine; NaN beyond 1e5 rad."""
    return _shifted_sine(x, 0.0)


@njit(forceinline=True, fastmath={"contract"})
def cos(x: float) -> float:
    """The cosine; NaN beyond 1e5 rad."""
    return _shifted_sine(x, 1.0)


# --- laws --------------------------------------------------------------------------------------

_BUILTINS = frozenset({"abs", "max", "min", "float", "bool"})
_LOOPS = ("JUMP_BACKWARD", "FOR_ITER", "SEND")


def vectorised_law(law: Callable[..., Any]) -> FunctionType | None:
    """Return a law with this module for `math`, None where LLVM could not vectorise it.

    It cannot be where it loops, raises to a power by `**`, or calls what has no twin here.
    """
    return _vectorised(law, {})


def _vectorised(
    law: Callable[..., Any], done: dict[object, FunctionType | None]
) -> FunctionType | None:
    function = getattr(law, "py_func", law)
    if function in done:
        return done[function]
    done[function] = None
    if not isinstance(function, FunctionType) or function.__closure__:
        return None
    names = _globals_of(function)
    if names is None:
        return None
    namespace: dict[str, Any] = {"__name__": function.__module__}
    for name in names:
        if name in function.__globals__:
            value = function.__globals__[name]
        elif name in _BUILTINS:
            continue
        else:
            return None
        twin = _twin(value, done)
        if twin is None:
            return None
        namespace[name] = twin
    own = FunctionType(function.__code__, namespace, function.__name__, function.__defaults__)
    own.__qualname__ = function.__qualname__
    own.__module__ = function.__module__
    done[function] = own
    return own


def _twin(value: object, done: dict[object, FunctionType | None]) -> object | None:
    """Return what stands in for a global of a law, None where nothing can."""
    if value is math:
        import sys

        return sys.modules[__name__]
    if isinstance(value, int | float):
        return value
    if isinstance(value, Compiled | FunctionType):
        found = _vectorised(value, done)
        return None if found is None else njit(forceinline=True, fastmath={"contract", "arcp"},
                                               error_model="numpy")(found)  # fmt: skip
    return None


def _globals_of(function: FunctionType) -> set[str] | None:
    """Return the globals that a function reads, None where something in it cannot be vectorised."""
    names: set[str] = set()
    module = ""
    for step in dis.get_instructions(function):
        if step.opname in _LOOPS or (step.opname == "BINARY_OP" and step.argrepr.startswith("**")):
            return None
        if module:
            if step.opname not in ("LOAD_ATTR", "LOAD_METHOD") or not _offers(str(step.argval)):
                return None
            module = ""
        if step.opname == "LOAD_GLOBAL":
            names.add(str(step.argval))
            if function.__globals__.get(step.argval) is math:
                module = str(step.argval)
    return names


def _offers(name: str) -> bool:
    own: Mapping[str, object] = globals()
    return hasattr(math, name) and name in own
