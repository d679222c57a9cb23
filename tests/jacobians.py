"""The one place where derivatives are taken by differences."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_STEP = 6e-6  # cube root of the rounding unit: best for central differences of values near one


def assert_jacobian(
    f: Callable[[Any], Any],
    x: Any,
    J: Floats,
    retract: Callable[[Any, Floats], Any] = lambda x, d: x + d,
    local: Callable[[Any, Any], Floats] = lambda y0, y: y - y0,
    rtol: float = 1e-6,
    atol: float = 1e-8,
) -> None:
    """Assert that J (m, n) is the derivative of `f` at `x`, against central differences on the manifold.

    Column k of J is d local(f(x), f(retract(x, d))) / d d_k at d = 0. An entry may be off by `rtol` of the
    largest entry in J, plus `atol`.

    Args:
        f: the function; of anything that `retract` takes, to anything that `local` takes.
        x: where.
        J: (m, n) the analytic derivative.
        retract: moves a point of the domain along a tangent vector (n,).
        local: the tangent vector (m,) from one value to another.
    """
    J = np.asarray(J, dtype=np.float64)
    y0 = f(x)
    differences = np.empty_like(J)
    for k in range(J.shape[1]):
        d = np.zeros(J.shape[1])
        d[k] = _STEP
        ahead = np.ravel(local(y0, f(retract(x, d))))
        behind = np.ravel(local(y0, f(retract(x, -d))))
        differences[:, k] = (ahead - behind) / (2.0 * _STEP)
    scale = np.abs(J).max(initial=0.0)
    np.testing.assert_allclose(J, differences, rtol=0.0, atol=rtol * scale + atol)
