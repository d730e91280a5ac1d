"""Which of the arrays among a function's arguments are perturbed: a derivative needs no others."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

__all__ = ["Perturbed"]


class Perturbed:
    """The perturbed arrays, from the arguments of a rule of `jax.custom_jvp` with symbolic zeros."""

    def __init__(self, primals: Sequence[Any], tangents: Sequence[Any]) -> None:
        self._leaves, self._structure = jax.tree.flatten(tuple(primals))
        moves = jax.tree.leaves(tuple(tangents), is_leaf=lambda t: isinstance(t, SymbolicZero))
        self.where = [i for i, t in enumerate(moves) if not isinstance(t, SymbolicZero)]
        self.primals: tuple[Array, ...] = tuple(self._leaves[i] for i in self.where)
        self.tangents: tuple[Array, ...] = tuple(moves[i] for i in self.where)

    def __bool__(self) -> bool:
        return bool(self.where)

    def replaced(
        self,
        moving: Sequence[Array],
        others: Callable[[int, Array], Array] = lambda number, x: x,
    ) -> tuple[Any, ...]:
        """The arguments with other values in the perturbed arrays; `others` are mapped."""
        new = dict(zip(self.where, moving, strict=True))
        leaves = [new[i] if i in new else others(i, x) for i, x in enumerate(self._leaves)]
        return jax.tree.unflatten(self._structure, leaves)

    def tangent(self, f: Callable[..., Any]) -> Any:
        """That of f(*arguments)."""

        def of_moving(*moving: Array) -> Any:
            return f(*self.replaced(moving))

        return jax.jvp(of_moving, self.primals, self.tangents)[1]
