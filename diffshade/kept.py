"""Programs that outlive a process: traced once, and kept beside what JAX keeps of their compilation.

JAX's cache on disk spares a later process the compiler, but not the tracing, which for a long program
takes longer than all else. Where that cache is switched on (`jax_compilation_cache_dir`), a kept program
lies there too, as StableHLO (`jax.export`), under a digest of all that it came from: the source of its
package, the versions of what traces it, the precision, and the structure, shapes and types of its
arguments. A program that depends on a class of anybody else's is not kept.
"""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax import export

from diffshade.errors import BadInput
from diffshade.io.atomic import replacing

__all__ = ["Kept"]

FOLDER = "diffshade"
KNOWN = {"builtins", "collections", "diffshade", "fitting", "jax", "numpy"}
"""Packages whose classes are told by their names, their source or version being in the digest."""


class Kept:
    """`jax.jit(function, compiler_options=options())`, of a function of arrays to tuples of arrays.

    `function` is one of a module, where its name tells it apart from all others.
    """

    def __init__(self, function: Callable[..., Any], options: Callable[[], Any]) -> None:
        self.function, self.options = function, options
        self._programs: dict[Any, Callable[[list[Any]], Any]] = {}

    def __call__(self, *arguments: Any) -> Any:
        leaves, structure = jax.tree.flatten(arguments)
        leaves = [x if hasattr(x, "dtype") else np.asarray(x) for x in leaves]
        kinds = tuple((x.shape, x.dtype) for x in leaves)
        key = structure, kinds, jax.config.jax_enable_x64  # type: ignore[attr-defined]
        if key not in self._programs:
            self._programs[key] = self._program(structure, leaves, repr(key))
        return self._programs[key](leaves)

    def _program(self, structure: Any, leaves: list[Any], key: str) -> Callable[[list[Any]], Any]:
        def flat(leaves: list[Any]) -> Any:
            return self.function(*jax.tree.unflatten(structure, leaves))

        folder = _folder(structure)
        if folder is None:
            return jax.jit(flat, compiler_options=self.options())
        name = f"{self.function.__module__}.{self.function.__qualname__}"
        precision = jax.config.jax_default_matmul_precision  # type: ignore[attr-defined]
        classes = {f"{kind.__module__}.{kind.__qualname__}" for kind in _classes(structure)}
        parts = (
            name,
            key,
            *sorted(classes),
            jax.default_backend(),
            str(precision),
            _origin(name.partition(".")[0]),
        )
        whole = "\n".join(parts)
        path = folder / FOLDER / hashlib.blake2b(whole.encode(), digest_size=16).hexdigest()
        kept = _read(path)
        if kept is None:
            kept = export.export(jax.jit(flat))(leaves)
            _write(path, kept.serialize())
        return jax.jit(kept.call, compiler_options=self.options())


def _folder(structure: Any) -> Path | None:
    """Where programs are kept; None where JAX keeps none, or what they depend on is not told by name.

    The class of an argument, a lobe, say, may be anybody's: its source is no part of the digest.
    """
    config: Any = jax.config
    folder = config.jax_compilation_cache_dir
    elsewhere = config.jax_default_device is not None
    if not folder or not config.jax_enable_compilation_cache or elsewhere or "://" in folder:
        return None
    return Path(folder) if all(_is_known(x) for x in _classes(structure)) else None


def _classes(structure: Any) -> Iterator[type]:
    """Of all nodes of a tree."""
    data = structure.node_data()
    if data is not None:
        yield data[0]
    for child in structure.children():
        yield from _classes(child)


def _is_known(kind: type) -> bool:
    return kind.__module__.partition(".")[0] in KNOWN


def _read(path: Path) -> export.Exported | None:
    """What is kept there; None where nothing is that can be read."""
    try:
        return export.deserialize(bytearray(path.read_bytes()))
    except Exception:
        return None


def _write(path: Path, content: bytearray) -> None:
    """Whole or not at all; a folder that cannot be written to keeps nothing."""
    with suppress(OSError, BadInput):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_bytes(content)


@cache
def _origin(package: str) -> str:
    """The versions of what traces, and a digest of the source of a package and this one."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted({package, __name__.partition(".")[0]}):
        folder = Path(str(import_module(name).__file__)).parent
        for file in sorted(folder.rglob("*.py")):
            digest.update(f"{name} {file.relative_to(folder)}\n".encode())
            digest.update(file.read_bytes())
    versions = " ".join(version(name) for name in ("jax", "jaxlib", "equinox", "optimistix"))
    return f"{versions} {digest.hexdigest()}"
