"""A long fit of maps that is killed at random moments and resumed: `kills_survived`.

`python kills.py FOLDER RESULT` is the fit itself.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np

import diffshade as ds
import fitting
from diffshade.io.atomic import replacing

__all__ = ["kills_survived"]

SIZE, LIGHTS, BLOCK = 112, 24, 240
BEGUN = "begun"
PLANES = ("coefficients", "standard_errors", "nominal_errors", "identified")
ARRAYS = ("noise", "converged", "residual")


def kills_survived(kills: int, seed: int, folder: Path) -> int:
    """How many of so many kills left the final maps those of an undisturbed run, bit for bit.

    The process is ended by the system (SIGKILL, where there is one), which gives it no chance to put
    anything in order: after up to a quarter of the time that the undisturbed run takes, and again after
    each resumption. A fit that is done before its turn is compared, and begun anew.
    """
    rng = np.random.default_rng(seed)
    started = _start(folder / "undisturbed", folder / "whole.npz")
    begun = time.monotonic()
    assert started.wait() == 0
    duration = time.monotonic() - begun
    whole = _loaded(folder / "whole.npz")
    survived = tried = since_start = 0
    while True:
        blocks, result = folder / "blocks", folder / "result.npz"
        process = _start(blocks, result)
        if tried < kills:
            try:
                process.wait(timeout=rng.uniform(0, duration / 4))
            except subprocess.TimeoutExpired:
                process.kill()
        if process.wait() != 0:
            assert process.returncode in (-getattr(signal, "SIGKILL", 9), 1)
            tried, since_start = tried + 1, since_start + 1
            assert not result.exists()
            continue
        found = _loaded(result)
        assert found.keys() == whole.keys()
        changed = [name for name in whole if found[name].tobytes() != whole[name].tobytes()]
        left = _names(blocks) ^ _names(folder / "undisturbed")
        if changed or left:
            print(f"after {since_start} kills: {changed} differ, {left} left behind")
        else:
            survived += since_start
        since_start = 0
        if tried == kills:
            return survived
        shutil.rmtree(blocks)
        result.unlink()


def _start(blocks: Path, result: Path) -> subprocess.Popen[str]:
    """The fit in a process of its own, when its blocks have begun."""
    config = jax.config
    environment = {
        "PYTHONPATH": os.pathsep.join(sys.path),
        "JAX_ENABLE_X64": str(config.jax_enable_x64),  # type: ignore[attr-defined]
        "JAX_COMPILATION_CACHE_DIR": str(config.jax_compilation_cache_dir or ""),  # type: ignore[attr-defined]
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    }
    process = subprocess.Popen(
        [sys.executable, __file__, str(blocks), str(result)],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    with process.stdout as said:  # and nothing more is
        assert said.readline().strip() == BEGUN
    return process


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def _loaded(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as file:
        return dict(file)


def _fit(blocks: Path, result: Path) -> None:
    """Random maps under random lights, with noise: the same in every process."""
    rng = np.random.default_rng(0)
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(SIZE, SIZE, 2.2))
    shape = 1, gbuffer.pixel_count
    material = ds.Material(
        kd=rng.uniform(0.1, 0.9, shape),
        specular=ds.Phong(ks=rng.uniform(0.05, 0.9, shape), shininess=rng.uniform(2, 90, shape)),
    )
    directions = rng.normal(0, 0.6, (LIGHTS, 3)) + np.array([0, 0, 1.5])
    scenes = [ds.Scene(lights=ds.ParallelLight(direction)) for direction in directions]
    images = [np.asarray(ds.render(gbuffer, scene, material)) for scene in scenes]
    images = [image + rng.normal(0, 1e-3, image.shape) for image in images]
    print(BEGUN, flush=True)
    maps = fitting.fit_maps(images, gbuffer, scenes, block=BLOCK, folder=blocks)
    arrays = {name: getattr(maps, name) for name in ARRAYS}
    for planes in PLANES:
        arrays |= {f"{planes} {name}": plane for name, plane in getattr(maps, planes).items()}
    with replacing(result) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


if __name__ == "__main__":
    _fit(Path(sys.argv[1]), Path(sys.argv[2]))
