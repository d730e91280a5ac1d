"""How XLA is led to the fast program; the reasons stand here, the equations elsewhere.

- The options of `compiler_options` let XLA use 512-bit vectors on a CPU that has them, which about
  halves the time of shading. A `jit` that carries options cannot be nested in another, so `render` sets
  them only when it is called outermost; whoever composes it passes them to the outermost `jit` of their
  own program:

      jax.jit(step, compiler_options=ds.compiler_options())

- A search is a program of hundreds of small kernels, whose compilation takes a thousand times as long
  as its run. `search_options` asks for XLA's older way of writing kernels, while it has one (before
  0.12): such a program compiles in half the time, and small linear systems run up to five times as fast.
- Shading and the scatter into an image are two programs when `render` is outermost. In one, XLA would
  fuse the shading into the scatter, and compute it again, point by point, for every channel.
- XLA computes anew, in every sum that reads it, whatever it can fuse into the sum, an exponential as
  well; a barrier for the optimiser is gone before it fuses. `stored` is a branch that is always
  taken, which nothing fuses across: five sums of one lobe run five times as fast.
- Planes, not [..., 3] arrays: see `vector`. Many lights in chunks: see `shading.lights`.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import jaxlib
from jax import lax

__all__ = ["compiler_options", "search_options", "stored"]

Options = dict[str, bool | int | str]


def compiler_options() -> Options:
    """The options of `jax.jit(..., compiler_options=...)` that suit shading on the default platform.

    >>> import jax
    >>> double = jax.jit(lambda x: 2 * x, compiler_options=compiler_options())
    """
    return {"xla_cpu_prefer_vector_width": 512} if jax.default_backend() == "cpu" else {}


def search_options() -> Options:
    """Those that suit a program of many small parts, as a search over coefficients is."""
    version = tuple(int(part) for part in jaxlib.__version__.split(".")[:2])
    older = jax.default_backend() == "cpu" and version < (0, 12)
    return compiler_options() | ({"xla_cpu_use_fusion_emitters": False} if older else {})


def stored(compute: Callable[..., Any], *arguments: Any) -> Any:
    """`compute(*arguments)`, computed once and read by all that use it."""
    always = lax.optimization_barrier(jnp.ones((), bool))
    shapes = jax.eval_shape(compute, *arguments)

    # A function of its own, for methods of modules have no hash
    def as_asked(*arguments: Any) -> Any:
        return compute(*arguments)

    def never(*_: Any) -> Any:
        return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)

    return lax.cond(always, as_asked, never, *arguments)
