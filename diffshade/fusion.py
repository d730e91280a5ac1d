"""How XLA is led to the fast program; the reasons stand here, the equations elsewhere.

- The options below let XLA use 512-bit vectors on a CPU that has them, which about halves the time of
  shading. A `jit` that carries options cannot be nested in another, so `render` sets them only when it
  is called outermost; whoever composes it passes them to the outermost `jit` of their own program:

      jax.jit(step, compiler_options=ds.compiler_options())

- Shading and the scatter into an image are two programs when `render` is outermost. In one, XLA would
  fuse the shading into the scatter, and compute it again, point by point, for every channel.
- Planes, not [..., 3] arrays: see `vector`. Many lights in chunks: see `shading.lights`.
"""

import jax

__all__ = ["compiler_options"]


def compiler_options() -> dict[str, bool | int | str]:
    """The options of `jax.jit(..., compiler_options=...)` that suit shading on the default platform.

    >>> import jax
    >>> double = jax.jit(lambda x: 2 * x, compiler_options=compiler_options())
    """
    return {"xla_cpu_prefer_vector_width": 512} if jax.default_backend() == "cpu" else {}
