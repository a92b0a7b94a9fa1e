"""Programs of which compiling takes longer than running, compiled quickly; others thoroughly."""

from collections.abc import Callable
from functools import cache, cached_property, update_wrapper
from typing import Any

import jax

#: Numbers that a program gets up to which it is compiled quickly: about 10 000 samples.
FEW = 1 << 16
#: The older of the two ways in which XLA writes loops for a processor: it takes half to two thirds
#: of the time to compile, and its code a tenth longer to run.
_QUICK = {"xla_cpu_use_fusion_emitters": False}


class Program:
    """A function as `jax.jit` compiles it when first called, quickly where it gets few numbers.

    Not to be called by another compiled function, whose options would be its own.

    Parameters
    ----------
    function : callable
    static_argnums : int or tuple of int
        As those of `jax.jit`.
    """

    def __init__(
        self, function: Callable[..., Any], static_argnums: int | tuple[int, ...] = ()
    ) -> None:
        self._function = function
        self._static = (static_argnums,) if isinstance(static_argnums, int) else static_argnums
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Call the function."""
        moving = [one for k, one in enumerate(arguments) if k not in self._static]
        numbers = sum(getattr(leaf, "size", 1) for leaf in jax.tree.leaves(moving))
        return (self._quick if numbers <= FEW else self._thorough)(*arguments)

    @property
    def compiled(self) -> int:
        """How often it was compiled."""
        return int(self._quick._cache_size() + self._thorough._cache_size())

    def clear_cache(self) -> None:
        """Forget what was compiled."""
        self._quick.clear_cache()
        self._thorough.clear_cache()

    @cached_property
    def _quick(self) -> Any:
        options = _quick_options()
        return jax.jit(self._function, static_argnums=self._static, compiler_options=options)

    @cached_property
    def _thorough(self) -> Any:
        # A function of its own: what JAX keeps of a function it keeps for all its options.
        def thorough(*arguments: Any) -> Any:
            return self._function(*arguments)

        return jax.jit(update_wrapper(thorough, self._function), static_argnums=self._static)


@cache
def _quick_options() -> dict[str, bool] | None:
    """Return the options, None where there are none of that name, or no processor to compile for.

    XLA keeps no option for ever.
    """
    if jax.default_backend() != "cpu":
        return None
    try:
        jax.jit(lambda: 0, compiler_options=_QUICK)()
    except (RuntimeError, ValueError):
        return None
    return _QUICK
