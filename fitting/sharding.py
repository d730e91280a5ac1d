"""The same program on every device that a capture's blocks lie on.

Each device sums over its own blocks, and `stream` adds the sums up; everything else is small, and done by
all of them alike. Devices see the same sums, to the last bit, and so take the same steps: processors of
one kind are asked for.
"""

from collections.abc import Callable
from functools import cache, wraps
from typing import Any, TypeVar

import jax
from jax.sharding import Mesh, PartitionSpec

from diffshade.fusion import compiler_options
from fitting.devices import place
from fitting.observation import Group

__all__ = ["over_devices"]

T = TypeVar("T")


def over_devices(function: Callable[..., T]) -> Callable[..., T]:
    """`function`, compiled for the platform, and run on the devices that its arguments' blocks lie on.

    What it returns has to be the same on each, as what follows from `sum_over_blocks` is; it comes
    back on one. On several devices JAX checks that.
    """

    @cache
    def program(mesh: Mesh | None) -> Callable[..., T]:
        each = function
        if mesh is not None:
            each = jax.shard_map(function, mesh=mesh, out_specs=PartitionSpec())
        return jax.jit(each, compiler_options=compiler_options())

    @wraps(function)
    def run(*arguments: Any) -> T:
        mesh = _mesh(arguments)
        if mesh is None:
            return program(None)(*arguments)
        found = program(mesh)(*place(arguments, mesh))
        return jax.tree.map(lambda x: x.addressable_data(0), found)

    return run


def _mesh(arguments: tuple[Any, ...]) -> Mesh | None:
    """The mesh that any blocks among the arguments were dealt out over."""
    parts = jax.tree.leaves(arguments, is_leaf=lambda part: isinstance(part, Group))
    return next((part.mesh for part in parts if isinstance(part, Group) and part.mesh), None)
