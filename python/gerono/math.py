"""Elementary functions with the same bytes on every machine, for controllers.

Those of Python's `math` and of numpy come from the machine's libraries, and may differ in the last bit from one machine to
another; so may `@` and `numpy.dot`, whose order of summation depends on the machine. `+ - * /` and `sqrt` do not.
"""

from __future__ import annotations

from collections.abc import Callable

from gerono._gerono import elementary_functions

_ONE, _TWO = elementary_functions()

acos: Callable[[float], float] = _ONE["acos"]
asin: Callable[[float], float] = _ONE["asin"]
atan: Callable[[float], float] = _ONE["atan"]
cbrt: Callable[[float], float] = _ONE["cbrt"]
cos: Callable[[float], float] = _ONE["cos"]
cosh: Callable[[float], float] = _ONE["cosh"]
exp: Callable[[float], float] = _ONE["exp"]
expm1: Callable[[float], float] = _ONE["expm1"]
log: Callable[[float], float] = _ONE["log"]
log10: Callable[[float], float] = _ONE["log10"]
log1p: Callable[[float], float] = _ONE["log1p"]
sin: Callable[[float], float] = _ONE["sin"]
sinh: Callable[[float], float] = _ONE["sinh"]
tan: Callable[[float], float] = _ONE["tan"]
tanh: Callable[[float], float] = _ONE["tanh"]
atan2: Callable[[float, float], float] = _TWO["atan2"]
hypot: Callable[[float, float], float] = _TWO["hypot"]
pow: Callable[[float, float], float] = _TWO["pow"]
