"""Maps whose work is interrupted, and goes on."""

from pathlib import Path

import numpy as np
import pytest
from kills import kills_survived
from map_cases import GBUFFER, KD, KS, PIXELS, SIZE, N, rendered, scenes, truth

import diffshade as ds
import fitting
from fitting import pixel_maps, region_maps
from fitting.pixel import CHUNK


class Interrupted(Exception):
    """Stands for Ctrl-C."""


@pytest.mark.parametrize("steps", [None, 8])
def test_an_interrupt_loses_no_finished_block(
    tmp_path: Path, steps: int | None, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    lit = scenes(8)
    images = rendered(lit, truth(rng))
    folder, block = tmp_path / "maps", 2 * CHUNK
    count = -(-PIXELS // block)
    assert count >= 2

    def stop(done: int, total: int) -> None:
        assert total == count
        if done == count - 1:
            raise Interrupted

    whole = fitting.fit_maps(images, GBUFFER, lit, steps=steps, block=block)
    with pytest.raises(Interrupted):
        fitting.fit_maps(
            images, GBUFFER, lit, steps=steps, block=block, folder=folder, progress=stop
        )
    files = sorted(path.name for path in folder.iterdir())
    assert files == sorted(["blocks.json", *(f"block-{i:05d}.npz" for i in range(count - 1))])

    begun: list[int] = []
    real = pixel_maps.fit_block
    monkeypatch.setattr(pixel_maps, "fit_block", lambda *a: begun.append(1) or real(*a))
    again = fitting.fit_maps(images, GBUFFER, lit, steps=steps, block=block, folder=folder)
    assert len(begun) == 1
    for name in (KD, KS, N):
        np.testing.assert_array_equal(again.coefficients[name], whole.coefficients[name])
        np.testing.assert_array_equal(again.identified[name], whole.identified[name])
    assert again.relative_residual == whole.relative_residual


def test_regions_resume_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lit = scenes(4)
    images = rendered(lit, ds.Material(kd=0.5, specular=ds.Phong(0.4, 20.0)))
    halves = np.arange(SIZE)[:, None] // 20 + np.zeros((1, SIZE), int)
    first = fitting.fit_maps(images, GBUFFER, lit, regions=halves, folder=tmp_path)
    monkeypatch.delattr(region_maps, "fit")  # nothing is left to be fitted
    again = fitting.fit_maps(images, GBUFFER, lit, regions=halves, folder=tmp_path)
    np.testing.assert_array_equal(again.coefficients[N], first.coefficients[N])


def test_a_folder_of_something_else_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    lit = scenes(8)
    images = rendered(lit, truth(rng))
    folder = tmp_path / "maps"
    fitting.fit_maps(images, GBUFFER, lit, steps=8, folder=folder)
    dimmer = [images[0] * 0.999, *images[1:]]
    for changed in (
        lambda: fitting.fit_maps(dimmer, GBUFFER, lit, steps=8, folder=folder),
        lambda: fitting.fit_maps(images, GBUFFER, scenes(8, seed=1), steps=8, folder=folder),
        lambda: fitting.fit_maps(images, GBUFFER, lit, steps=9, folder=folder),
        lambda: fitting.fit_maps(
            images, GBUFFER, lit, steps=8, folder=folder, bounds={KS: (0.0, 2.0)}
        ),
        lambda: fitting.fit_maps(
            images,
            GBUFFER,
            lit,
            steps=8,
            folder=folder,
            material=ds.Material(kd=0.5, specular=ds.BlinnPhong(0.5, 30.0)),
        ),
    ):
        with pytest.raises(ds.BadInput, match=r"other images, scenes or options") as caught:
            changed()
        assert "\n" not in str(caught.value)
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(ds.BadInput, match="other files"):
        fitting.fit_maps(images, GBUFFER, lit, steps=8, folder=tmp_path)


def test_a_damaged_block_is_computed_anew(tmp_path: Path, rng: np.random.Generator) -> None:
    lit = scenes(8)
    images = rendered(lit, truth(rng))
    whole = fitting.fit_maps(images, GBUFFER, lit, steps=8, folder=tmp_path)
    (block,) = tmp_path.glob("block-*.npz")
    content = block.read_bytes()
    for damage in (b"", content[: len(content) // 2]):
        block.write_bytes(damage)
        again = fitting.fit_maps(images, GBUFFER, lit, steps=8, folder=tmp_path)
        np.testing.assert_array_equal(again.coefficients[N], whole.coefficients[N])
        assert block.read_bytes() == content


@pytest.mark.slow
def test_a_killed_fit_ends_as_if_nothing_had_been(tmp_path: Path) -> None:
    assert kills_survived(3, 1, tmp_path) == 3


@pytest.mark.long
def test_twenty_kills(tmp_path: Path) -> None:
    assert kills_survived(20, 2, tmp_path) == 20
