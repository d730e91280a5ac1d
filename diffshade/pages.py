"""Functions of pixels, evaluated page after page, with derivatives that cost no more memory.

What a page of pixels needs on the way stays in the cache, and memory beyond input and output is that
of one page, whatever the size of the image. A tree like the arguments says which of them are planes,
whose last axis is that of the pixels; every page has its own part of these, and all of the others.

A value is cut from its planes and written into place. For a derivative a scan goes through the pages
and computes again what each computed on the way, rather than keep it for all of them; only what is
perturbed is differentiated. All is in JAX's own loops, so that every order and mode of derivative,
`vmap` and `scan` hold. A sum over pixels has its derivative computed beside its value.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from diffshade.perturbed import Perturbed

__all__ = ["map_pages", "sum_pages"]

Arguments = tuple[Any, ...]
Planes = tuple[Float[Array, "P"], ...]

HELD = 2**18
"""The largest image whose derivative in numbers keeps what it needs."""

LANES = 16
"""Pages are multiples of as many pixels as the widest vector holds."""


def map_pages(
    f: Callable[..., Planes],
    arguments: Arguments,
    planes: Arguments,
    count: int,
    page: int,
    for_derivative: Callable[..., Planes],
    page_for_derivative: int,
    plain: Callable[..., Planes] | None,
    wanted: Int[Array, ""] | None = None,
) -> Planes:
    """f(*arguments), which gives planes [P] or rows [P, C] of `count` pixels, each from its own alone.

    Of pixels past the first `wanted`, where that is given, the value may be anything.

    `for_derivative` is the same function, written to be differentiated page by page, and `plain` the
    one that JAX differentiates as it stands: where numbers alone are perturbed, and the image is not
    large, keeping what they need of all pixels is faster than to compute it again (None: never).
    """
    pages = _Pages(count, page, planes, wanted)
    scan = _Pages(count, page_for_derivative, planes, wanted)

    @jax.custom_jvp
    def evaluate(*arguments: Any) -> Planes:
        def write(number: Array, out: Planes) -> Planes:
            new = f(*pages.cut(arguments, number))
            pairs = zip(out, new, strict=True)
            return tuple(pages.write(o, x, number, axis=0) for o, x in pairs)

        shapes = jax.eval_shape(lambda: f(*pages.cut(arguments, 0)))
        start = tuple(jnp.zeros((count, *s.shape[1:]), s.dtype) for s in shapes)
        return lax.fori_loop(0, pages.needed, write, start)

    def rule(primals: Arguments, tangents: Arguments) -> tuple[Planes, Planes]:
        moved = Perturbed(primals, tangents)
        numbers_alone = not any(pages.is_plane[i] for i in moved.where)
        if moved and plain is not None and count <= HELD and numbers_alone:

            def held(*moving: Array) -> Planes:
                return plain(*moved.replaced(moving))

            return jax.jvp(held, moved.primals, moved.tangents)
        value = evaluate(*primals)
        if not moved:
            return value, jax.tree.map(jnp.zeros_like, value)

        def scanned(*moving: Array) -> Planes:
            places = enumerate(zip(moved.where, moving, strict=True))
            stacks = {k: scan.stack(x) for k, (i, x) in places if scan.is_plane[i]}

            @jax.checkpoint
            def one(own: dict[int, Array], moving: tuple[Array, ...], number: Array) -> Planes:
                parts = tuple(own.get(k, x) for k, x in enumerate(moving))
                return for_derivative(*moved.replaced(parts, scan.cutter(number)))

            _, out = lax.scan(
                lambda _, at: (None, one(at[0], moving, at[1])),
                None,
                (stacks, jnp.arange(scan.number)),
            )
            return tuple(scan.join(plane) for plane in out)

        return value, jax.jvp(scanned, moved.primals, moved.tangents)[1]

    evaluate.defjvp(rule, symbolic_zeros=True)
    return evaluate(*arguments)


def sum_pages(
    f: Callable[..., Float[Array, ""]],
    arguments: Arguments,
    planes: Arguments,
    count: int,
    page: int,
    wanted: Int[Array, ""] | None = None,
) -> Float[Array, ""]:
    """The sum over `count` pixels of f(own, *arguments), which sums over those where `own` holds.

    The sum is over the first `wanted` pixels, where that is given.

    Its derivative is computed beside the value, in one way through the pages.
    """
    pages = _Pages(count, page, planes, wanted)

    def of_page(number: Array, *arguments: Any) -> Float[Array, ""]:
        return f(pages.own(number), *pages.cut(arguments, number))

    def zero(*arguments: Any) -> Float[Array, ""]:
        return jnp.zeros((), jax.eval_shape(of_page, jnp.asarray(0), *arguments).dtype)

    @jax.custom_jvp
    def evaluate(*arguments: Any) -> Float[Array, ""]:
        def add(number: Array, total: Float[Array, ""]) -> Float[Array, ""]:
            return total + of_page(number, *arguments)

        return lax.fori_loop(0, pages.needed, add, zero(*arguments))

    def rule(primals: Arguments, tangents: Arguments) -> tuple[Array, Array]:
        moved = Perturbed(primals, tangents)
        if not moved:
            value = evaluate(*primals)
            return value, jnp.zeros_like(value)

        def add(number: Array, so_far: tuple[Array, tuple[Array, ...]]) -> Any:
            total, gradient = so_far
            own = pages.own(number)

            def of_moving(*moving: Array) -> Float[Array, ""]:
                return f(own, *moved.replaced(moving, cut))

            cut = pages.cutter(number)
            moving = tuple(cut(i, x) for i, x in zip(moved.where, moved.primals, strict=True))
            value, new = jax.value_and_grad(of_moving, range(len(moving)))(*moving)
            parts = zip(moved.where, gradient, new, strict=True)
            return total + value, tuple(pages.added(i, old, part, number) for i, old, part in parts)

        start = zero(*primals), tuple(jnp.zeros_like(x) for x in moved.primals)
        value, gradient = lax.fori_loop(0, pages.number, add, start)
        terms = [(g * t).sum() for g, t in zip(gradient, moved.tangents, strict=True)]
        return value, sum(terms[1:], terms[0]).astype(value.dtype)

    evaluate.defjvp(rule, symbolic_zeros=True)
    return evaluate(*arguments)


class _Pages:
    """Planes of P pixels as pages of one size; the last one overlaps the one before it."""

    def __init__(
        self, count: int, page: int, planes: Arguments, wanted: Int[Array, ""] | None
    ) -> None:
        self.is_plane: list[bool] = jax.tree.leaves(planes)
        self.count = count
        self.number = -(-count // page)
        size = -(-count // self.number // LANES) * LANES
        self.size = min(size, count)
        self.wanted = wanted
        self.needed = self.number if wanted is None else -(-wanted // self.size)

    def start(self, number: Array | int) -> Array:
        return jnp.minimum(jnp.asarray(number) * self.size, self.count - self.size)

    def own(self, number: Array | int) -> Bool[Array, "size"]:
        """Which pixels of a page are not those of the page before it, and wanted."""
        pixel = jnp.arange(self.size) + self.start(number)
        own = pixel >= jnp.asarray(number) * self.size
        return own if self.wanted is None else own & (pixel < self.wanted)

    def cutter(self, number: Array | int) -> Callable[[int, Array], Array]:
        """To a page's part of the argument of a number, where that is a plane."""
        start = self.start(number)

        def cut(i: int, x: Array) -> Array:
            if not self.is_plane[i]:
                return x
            return lax.dynamic_slice_in_dim(x, start, self.size, axis=-1)

        return cut

    def cut(self, arguments: Arguments, number: Array | int) -> Arguments:
        """The arguments of a page."""
        leaves, structure = jax.tree.flatten(arguments)
        cut = self.cutter(number)
        return jax.tree.unflatten(structure, [cut(i, x) for i, x in enumerate(leaves)])

    def write(self, whole: Array, page: Array, number: Array, axis: int = -1) -> Array:
        return lax.dynamic_update_slice_in_dim(whole, page, self.start(number), axis)

    def added(self, i: int, total: Array, part: Array, number: Array) -> Array:
        """A page's share written into its place of a plane, or added to what is no plane."""
        if not self.is_plane[i]:
            return total + part
        before = self.cutter(number)(i, total)
        return self.write(total, jnp.where(self.own(number), part, before), number)

    def stack(self, plane: Array) -> Array:
        """[..., P] to [N, ..., size]."""
        whole = plane[..., : (self.number - 1) * self.size]
        whole = whole.reshape(*plane.shape[:-1], self.number - 1, self.size)
        last = plane[..., -self.size :]
        return jnp.concatenate([jnp.moveaxis(whole, -2, 0), last[None]])

    def join(self, pages: Array) -> Array:
        """[N, size, ...] to [P, ...]."""
        overlap = self.number * self.size - self.count
        whole = pages[:-1].reshape(-1, *pages.shape[2:])
        return jnp.concatenate([whole, pages[-1, overlap:]])
