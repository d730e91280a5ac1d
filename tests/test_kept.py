"""Programs that are kept on disk: traced once, never wrong, and no trouble where nothing can be kept."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.kept import Kept

TRACED: list[tuple[int, ...]] = []


def scaled(x: jax.Array, factor: float) -> tuple[jax.Array]:
    TRACED.append(x.shape)
    return (x * factor,)


def kept() -> Kept:
    """As in a new process."""
    TRACED.clear()
    return Kept(scaled, dict)


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / "diffshade"
    jax.config.update("jax_compilation_cache_dir", before)


def test_a_second_process_does_not_trace(folder: Path) -> None:
    x = jnp.arange(3.0)
    for traces in (1, 0):
        program = kept()
        np.testing.assert_array_equal(program(x, 2.0)[0], [0, 2, 4])
        np.testing.assert_array_equal(program(x, 3.0)[0], [0, 3, 6])
        assert len(TRACED) == traces
    assert len(list(folder.iterdir())) == 1


def test_shapes_types_and_precision_tell_programs_apart(folder: Path) -> None:
    program = kept()
    for count in (2, 3):
        assert program(jnp.ones(count), 2.0)[0].shape == (count,)
    for double in (False, True):
        with jax.enable_x64(double):
            ones = jnp.ones(4)
            assert program(ones, 2.0)[0].dtype == ones.dtype
    assert len(list(folder.iterdir())) == 4


def test_a_damaged_file_is_written_anew(folder: Path) -> None:
    x = jnp.arange(3.0)
    kept()(x, 2.0)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    for damage in (b"", b"nonsense", whole[: len(whole) // 2]):
        file.write_bytes(damage)
        np.testing.assert_array_equal(kept()(x, 2.0)[0], [0, 2, 4])
        assert TRACED
        assert file.stat().st_size == pytest.approx(len(whole), rel=0.1)


def test_where_nothing_can_be_written_nothing_is_kept(folder: Path) -> None:
    folder.write_text("a file where the folder would be")
    np.testing.assert_array_equal(kept()(jnp.arange(3.0), 2.0)[0], [0, 2, 4])
    assert TRACED


def test_without_a_cache_nothing_is_written(tmp_path: Path) -> None:
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    try:
        np.testing.assert_array_equal(kept()(jnp.arange(3.0), 2.0)[0], [0, 2, 4])
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
    assert not list(tmp_path.iterdir())


class Doubling(NamedTuple):
    """A part of somebody else's, whose source no digest knows."""

    x: jax.Array


def doubled(part: Doubling) -> tuple[jax.Array]:
    TRACED.append(part.x.shape)
    return (2 * part.x,)


def test_what_depends_on_foreign_classes_is_not_kept(folder: Path) -> None:
    np.testing.assert_array_equal(Kept(doubled, dict)(Doubling(jnp.ones(2)))[0], [2, 2])
    assert not folder.exists()


def test_a_cache_that_is_off_keeps_nothing(folder: Path) -> None:
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        kept()(jnp.arange(3.0), 2.0)
    finally:
        jax.config.update("jax_enable_compilation_cache", True)
    assert not folder.exists()
