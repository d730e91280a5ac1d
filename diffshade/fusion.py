"""How XLA is led to the fast program; the reasons stand here, the equations elsewhere.

On a CPU, XLA makes one loop of every array that a program gives away, a *root*, and of everything
between it and the arrays that it reads. Within a loop nothing costs memory. But:

- Two roots that share a logarithm compute it twice, in two loops; an image of three channels, or a
  gradient of thirteen numbers, does all its work as many times. `packed` computes planes two at a time,
  as the real and imaginary part of one root.
- What XLA can fuse into a loop that reads it, it does, and so computes it again for every reader; a
  barrier for the optimiser is gone before it fuses. `stored` is a branch that is always taken, which
  nothing fuses across: what is behind it is computed once.
- The derivative of an equation reads the same few expensive numbers again and again: a root of |s|^2, a
  power of r.v, a quotient. These are the `Node`s of a computation; each writes its derivative with its
  own value. Where `keeping` is on, for a derivative, their values are stored, and so is what `kept`
  computes from them. What remains are products and sums, which may well be computed again. Anywhere
  else nodes and `kept` are plain functions.
- Of a small loop over pages XLA makes one function with a slower compiler; `compiler_options` forbids
  that, and lets XLA use 512-bit vectors where a CPU has them. A `jit` that carries options cannot be
  nested in another, so a `Led` function has them only when it is called outermost; whoever composes it
  passes them to the outermost `jit` of their own program:

      jax.jit(step, compiler_options=ds.compiler_options())

- A search is a program of hundreds of small kernels, whose compilation takes a thousand times as long
  as its run. `search_options` asks for XLA's older way of writing kernels, while it has one (before JAX
  0.11.1): such a program compiles in half the time, and small linear systems run up to five times as
  fast.
- Pages (`pages`) keep in the cache what is stored; planes, not [..., 3] arrays: see `vector`; many
  lights in chunks: see `shading.lights`.

On other platforms shading is left to XLA (`is_led`).
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property, partial, update_wrapper
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import jaxlib
from jax import lax
from jaxtyping import Array

from diffshade.arrays import is_concrete, is_outermost
from diffshade.perturbed import Perturbed

__all__ = [
    "Led",
    "Node",
    "compiler_options",
    "is_keeping",
    "is_led",
    "keeping",
    "kept",
    "packed",
    "page_size",
    "processors",
    "search_options",
    "stored",
]

Options = dict[str, bool | int | str]


def is_led() -> bool:
    """Whether the default platform is one on which the program is led: a CPU."""
    return jax.default_backend() == "cpu"


def compiler_options() -> Options:
    """The options of `jax.jit(..., compiler_options=...)` that suit shading on the default platform.

    >>> import jax
    >>> double = jax.jit(lambda x: 2 * x, compiler_options=compiler_options())
    """
    if not is_led():
        return {}
    return {
        "xla_cpu_prefer_vector_width": 512,
        "xla_disable_hlo_passes": "small-while-loop-hoisting",
    }


def search_options() -> Options:
    """Those that suit a program of many small parts, as a search over coefficients is."""
    version = tuple(int(part) for part in jaxlib.__version__.split(".")[:3])
    older = is_led() and version < (0, 11, 1)
    return compiler_options() | ({"xla_cpu_use_fusion_emitters": False} if older else {})


class Led:
    """`jax.jit(function)`, with the platform's options where it is called outermost, on values.

    `outermost` is that program, for those who know.
    """

    def __init__(self, function: Callable[..., Any], static: tuple[int, ...] = ()) -> None:
        update_wrapper(self, function)
        self.function, self.static = function, static
        self.nested = jax.jit(function, static_argnums=static)

    @cached_property
    def outermost(self) -> Callable[..., Any]:
        return jax.jit(
            self.function, static_argnums=self.static, compiler_options=compiler_options()
        )

    def __call__(self, *arguments: Any) -> Any:
        outermost = is_outermost() and is_concrete(arguments)
        return (self.outermost if outermost else self.nested)(*arguments)


def page_size(lights: int | None = None) -> int:
    """How many pixels are shaded at once: for a derivative, which keeps something of each of so many
    lights, or (None) for a value, which keeps a few planes.

    On one processor a page should fit into the cache; several share the loops over a larger one. A
    derivative holds some two hundred planes of a page: 26 MiB in float32.
    """
    alone = processors() == 1
    if lights is None:
        return 2**14 if alone else 2**18
    chunks = max(-(-lights // 4), 1)
    return max((2**14 if alone else 2**15) // chunks, 2**12)


def processors() -> int:
    """Those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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


def packed(compute: Callable[..., Any], *arguments: Any) -> Any:
    """`compute(*arguments)`, a tree of planes, stored and computed two planes at a time."""
    shapes, structure = jax.tree.flatten(jax.eval_shape(compute, *arguments))
    planes: dict[int, Array] = {}
    for group in _alike(shapes):

        def root(*arguments: Any, group: tuple[int, ...] = group) -> Array:
            leaves = jax.tree.leaves(compute(*arguments))
            return lax.complex(*(leaves[i] for i in group)) if len(group) == 2 else leaves[group[0]]

        both = stored(root, *arguments)
        planes |= zip(group, (both.real, both.imag) if len(group) == 2 else (both,), strict=True)
    return jax.tree.unflatten(structure, [planes[i] for i in range(len(shapes))])


def _alike(shapes: list[Any]) -> list[tuple[int, ...]]:
    """Pairs of arrays that a complex one can hold, and those that are left over."""
    groups: list[tuple[int, ...]] = []
    waiting: dict[Any, int] = {}
    for i, x in enumerate(shapes):
        kind = (x.shape, x.dtype)
        if x.dtype not in (jnp.float32, jnp.float64):
            groups.append((i,))
        elif kind in waiting:
            groups.append((waiting.pop(kind), i))
        else:
            waiting[kind] = i
    return groups + [(i,) for i in waiting.values()]


class Node:
    """A function of planes whose derivative is written with its value.

    `@node.derivative` declares it: from the value, the planes and their tangents (`SymbolicZero` where
    a plane is not perturbed) to the tangent of the value. The function itself needs finite derivatives
    too: in reverse mode JAX differentiates what a loop knows beforehand a second time without the rule.
    """

    def __init__(self, f: Callable[..., Array]) -> None:
        update_wrapper(self, f)
        self._f = f

    def derivative(self, rule: Callable[[Array, Any, Any], Array]) -> Callable[..., Array]:
        """Declare the derivative."""

        def with_rule(f: Callable[..., Array]) -> Callable[..., Array]:
            function = jax.custom_jvp(f)

            def jvp(planes: Any, tangents: Any) -> tuple[Array, Array]:
                value = function(*planes)
                return value, rule(value, planes, tangents)

            function.defjvp(jvp, symbolic_zeros=True)
            return function

        @jax.custom_jvp
        def known(value: Array, *planes: Array) -> Array:
            return value

        @partial(known.defjvp, symbolic_zeros=True)
        def _(primals: Any, tangents: Any) -> tuple[Array, Array]:
            value = known(*primals)  # not primals[0], which has no derivative of its own
            return value, rule(value, primals[1:], tangents[1:])

        self.computed = with_rule(self._f)
        self.stored = with_rule(partial(stored, self._f))
        self.known = known
        return rule

    def __call__(self, *planes: Array) -> Array:
        return _nodes.get()(self, *planes)


def keeping(compute: Callable[..., Any]) -> Callable[..., Any]:
    """`compute`, traced with its nodes stored: as its derivative should have it."""

    def traced(*arguments: Any) -> Any:
        with _as(_Stored()):
            return compute(*arguments)

    return traced


def is_keeping() -> bool:
    """Whether what is traced now is a derivative whose nodes are stored."""
    return isinstance(_nodes.get(), _Stored)


def kept(compute: Callable[..., Any], *arguments: Any) -> Any:
    """`compute(*arguments)`, a tree of planes, packed where `keeping` is on.

    Its nodes are stored first, in the order in which they are met, and read again by every root. Its
    derivative is that of the plain computation, with the values of the nodes.
    """
    if not is_keeping():
        return compute(*arguments)
    with _as(_Noted()) as noted:
        compute(*arguments)  # only its nodes are used: XLA drops the rest

    def replayed(values: tuple[Array, ...], *arguments: Any) -> Any:
        with _as(_Replayed(values)):
            return compute(*arguments)

    @jax.custom_jvp
    def evaluate(values: tuple[Array, ...], *arguments: Any) -> Any:
        return packed(replayed, values, *arguments)

    @partial(evaluate.defjvp, symbolic_zeros=True)
    def _(primals: Any, tangents: Any) -> Any:
        values, *arguments = primals
        moved = Perturbed(arguments, tangents[1:])
        value = evaluate(*primals)
        if not moved:
            return value, jax.tree.map(jnp.zeros_like, value)
        return value, moved.tangent(partial(replayed, values))

    return evaluate(tuple(lax.stop_gradient(x) for x in noted.values), *arguments)


class _Computed:
    """What becomes of a node: it is computed where it stands."""

    def __call__(self, node: Node, *planes: Array) -> Array:
        return node.computed(*planes)


class _Stored(_Computed):
    """It is stored."""

    def __call__(self, node: Node, *planes: Array) -> Array:
        return node.stored(*planes)


class _Noted(_Computed):
    """It is stored, and noted."""

    def __init__(self) -> None:
        self.values: list[Array] = []

    def __call__(self, node: Node, *planes: Array) -> Array:
        self.values.append(node.stored(*planes))
        return self.values[-1]


class _Replayed(_Computed):
    """It has the value that was noted."""

    def __init__(self, values: tuple[Array, ...]) -> None:
        self.values = iter(values)

    def __call__(self, node: Node, *planes: Array) -> Array:
        return node.known(next(self.values), *planes)


_nodes: ContextVar[_Computed] = ContextVar("nodes", default=_Computed())  # noqa: B039
N = TypeVar("N", bound=_Computed)


@contextmanager
def _as(nodes: N) -> Iterator[N]:
    token = _nodes.set(nodes)
    try:
        yield nodes
    finally:
        _nodes.reset(token)
