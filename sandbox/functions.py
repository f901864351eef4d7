"""Elementary functions in the precision of their argument, a number or a vector, whatever the device.

Vulkan has them for numbers of 32 bits alone. For those of 64 they are made here, to a few units in the last place:
the argument is brought near 0, and what is left goes into a power series. Both parts of pi / 2 and ln 2, of which the
first is exact times any small whole number, are those of fdlibm (Sun Microsystems 1993).
"""

import math

import taichi as ti

from sandbox import runtime

_QUARTER, _QUARTER_REST = 1.57079632673412561417, 6.07710050650619224932e-11
_LN2, _LN2_REST = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_LEAST_EXPONENT, _MOST_EXPONENT = -708.0, 709.0
"""Beyond them exp is no normal number."""
_BIAS, _FRACTION_BITS = 1023, 52
"""Of the exponent, and of the fraction, in the bits of a double."""
_ROOT_2 = math.sqrt(2.0)
_FRACTION = (1 << _FRACTION_BITS) - 1
_EXP = [1.0 / math.factorial(k) for k in range(15)]
_SIN = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(9)]
_COS = [(-1.0) ** k / math.factorial(2 * k) for k in range(10)]
_ARTANH = [1.0 / (2 * k + 1) for k in range(11)]
"""Coefficients of power series, from the constant one on, as many as count where they are used."""


@ti.func
def sin(x):
    """Sine of an angle [rad]."""
    if ti.static(runtime.lacks_functions()):
        return _wave(x, 0)
    else:
        return ti.sin(x)


@ti.func
def cos(x):
    """Cosine of an angle [rad]."""
    if ti.static(runtime.lacks_functions()):
        return _wave(x, 1)
    else:
        return ti.cos(x)


@ti.func
def exp(x):
    """e to the power of a number."""
    if ti.static(runtime.lacks_functions()):
        x = ti.min(ti.max(x, _LEAST_EXPONENT), _MOST_EXPONENT)
        n = ti.round(x / (_LN2 + _LN2_REST))
        power = ti.bit_cast((ti.cast(n, ti.i64) + ti.i64(_BIAS)) << ti.i64(_FRACTION_BITS), ti.f64)
        return power * _series(x - n * _LN2 - n * _LN2_REST, ti.static(_EXP))
    else:
        return ti.exp(x)


@ti.func
def log(x):
    """Natural logarithm of a number above 0."""
    if ti.static(runtime.lacks_functions()):
        bits = ti.bit_cast(x, ti.i64)
        n = ti.cast((bits >> ti.i64(_FRACTION_BITS)) - ti.i64(_BIAS), ti.f64)
        rest = ti.bit_cast((bits & ti.i64(_FRACTION)) | (ti.i64(_BIAS) << ti.i64(_FRACTION_BITS)), ti.f64)
        if rest > _ROOT_2:
            rest, n = 0.5 * rest, n + 1.0
        s = (rest - 1.0) / (rest + 1.0)
        return n * _LN2 + (n * _LN2_REST + 2.0 * s * _series(s * s, ti.static(_ARTANH)))
    else:
        return ti.log(x)


@ti.func
def _wave(x, ahead):
    """Sine, ``ahead`` by so many quarters of a turn."""
    n = ti.round(x / (_QUARTER + _QUARTER_REST))
    r = x - n * _QUARTER - n * _QUARTER_REST
    quarter = (ti.cast(n, ti.i32) + ahead) & 3
    value = ti.select((quarter & 1) == 1, _series(r * r, ti.static(_COS)), r * _series(r * r, ti.static(_SIN)))
    return ti.select((quarter & 2) == 2, -value, value)


@ti.func
def _series(x, coefficients: ti.template()):
    """Sum of c_k x^k."""
    total = 0.0 * x + coefficients[-1]
    for c in ti.static(coefficients[-2::-1]):
        total = total * x + c
    return total
