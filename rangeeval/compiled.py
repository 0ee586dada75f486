"""One decorator for the inner loops: compiled where numba can be had, the same plain Python where it can't.

Numba is imported when a module holding kernels is, so such modules are imported only by the command that needs
them. Kernels are cached on disk, release the interpreter lock, and keep IEEE arithmetic in written order
(`fastmath` off): a result must have the same bits on every run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile `function` with numba (`nogil`, cached), or return it unchanged where numba is not installed."""
    return _compiled(function, {})


def compiled_ieee(function: F) -> F:
    """The same, but a division by zero gives infinity or NaN instead of raising.

    For kernels that guard their divisions: without the branches that raise, their small loops vectorise.
    """
    return _compiled(function, _IEEE)


def compiled_borrowing(function: F) -> F:
    """As `compiled_ieee`, for a kernel that makes no array of its own and may not: it only borrows those it is given.

    References to arrays are not counted, so that a view of a row costs nothing (counting them took 40 % of a filter
    whose kernels hand rows to each other).
    """
    return _compiled(function, _BORROWING)


def compiled_inside(function: F) -> F:
    """As `compiled_borrowing`, for a function that only other such kernels call: not to be called from Python.

    It has no door to Python and no place of its own on disk (its callers have), which makes large kernels quicker to
    compile. Numba compiles it anew for each literal integer that it is passed as an argument; `AWAY + 0` is none.
    """
    return _compiled(function, {**_BORROWING, "no_cpython_wrapper": True, "cache": False})


_IEEE = {"error_model": "numpy"}
_BORROWING = {**_IEEE, "_nrt": False}


def _compiled(function: F, options: dict[str, Any]) -> F:
    try:
        import numba
        from numba.core.cpu import CPUTargetOptions
    except ImportError:
        return function
    # A numba without the option counts the references: slower, nothing else.
    known = {name: value for name, value in options.items() if name != "_nrt" or hasattr(CPUTargetOptions, name)}
    compiled_function: F = numba.njit(**{"nogil": True, "cache": True, "no_cfunc_wrapper": True, **known})(function)
    return compiled_function
