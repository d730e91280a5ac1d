"""Lights with extent: run time against error, by the samples along a side of a rectangle.

    python -m benchmarks.extent

A ball of 256 x 256 pixels under a lamp whose side is half its distance from the ball, and under one
close by. Diffuse reflection is held against Lambert's closed form for a polygon on the pixels that see
all of the lamp, and against 32 samples along a side elsewhere, as a Phong lobe is everywhere. Errors are
the largest, in parts of the brightest pixel; times are CPU time, the median of several rounds, over that
of one point light.
"""

import time
from functools import partial

import numpy as np

import diffshade as ds
from benchmarks.figures import in_turn, median

__all__ = ["main"]

SIZE = 256
LAMPS = {
    "far": ds.RectangleLight((0.8, 1.2, 3.0), (1.4, 0, -0.4), (0.1, -1.2, 0.5), 1.0),
    "near": ds.RectangleLight((0.3, 0.5, 1.4), (1.2, 0, -0.3), (0, -1.2, 0.4), 1.0),
}
SAMPLES = (1, 2, 3, 4, 6, 8, 12, 16)
FINEST = 32
MATTE = ds.Material(kd=1.0)
GLOSSY = ds.Material(specular=ds.Phong(ks=1.0, shininess=60.0))


def polygon(
    lamp: ds.RectangleLight, points: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The irradiance of radiance 1 after Lambert (1760), and where all corners are above the horizon."""
    center, u, v = (np.asarray(x, float) for x in (lamp.center, lamp.u, lamp.v))
    corners = [
        center + a * u + b * v for a, b in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
    ]
    towards = [c - points for c in corners]
    above = np.min([np.sum(s * normals, axis=1) for s in towards], axis=0) > 0
    unit = [s / np.linalg.norm(s, axis=1, keepdims=True) for s in towards]
    total = np.zeros(len(points))
    for a, b in zip(unit, unit[1:] + unit[:1], strict=True):
        across = np.cross(a, b)
        sine = np.linalg.norm(across, axis=1)
        angle = np.arctan2(sine, np.sum(a * b, axis=1))
        total += angle / sine * np.sum(across * normals, axis=1)
    return 0.5 * np.abs(total), above


def main() -> None:
    """Print the tables."""
    gbuffer = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(SIZE, SIZE, 2.2))
    points, normals = (np.asarray(x.to_array(), float) for x in (gbuffer.position, gbuffer.normal))

    def planes(lamp: object, material: ds.Material) -> np.ndarray:
        image = ds.render(gbuffer, ds.Scene(lights=lamp), material)
        return np.asarray(gbuffer.from_image(image))[0].astype(float)

    for name, lamp in LAMPS.items():
        exact, above = polygon(lamp, points, normals)
        finest = {id(m): planes(lamp.with_samples(FINEST), m) for m in (MATTE, GLOSSY)}
        scenes = {n: ds.Scene(lights=lamp.with_samples(n)) for n in SAMPLES}
        scenes[0] = ds.Scene(lights=ds.PointLight(lamp.center, 1.0, ds.InverseSquare()))
        calls = {
            n: partial(lambda s: ds.render(gbuffer, s, MATTE).block_until_ready(), scene)
            for n, scene in scenes.items()
        }
        seconds = {n: median(x) for n, x in in_turn(calls, 5, time.process_time).items()}
        print(f"\n{name} lamp\n")
        heads = ("samples a side", "time / one point light", "diffuse, closed form")
        print(f"| {' | '.join(heads)} | at the horizon | Phong, n = 60 |")
        print("|---|---|---|---|---|")
        for n in SAMPLES:
            matte, glossy = (planes(lamp.with_samples(n), m) for m in (MATTE, GLOSSY))
            brightest = exact[above].max()
            seen = np.abs(matte - exact)[above].max() / brightest
            cut = np.abs(matte - finest[id(MATTE)])[~above].max() / brightest
            mirrored = np.abs(glossy - finest[id(GLOSSY)]).max() / finest[id(GLOSSY)].max()
            ratio = seconds[n] / seconds[0]
            print(f"| {n} | {ratio:.1f} | {seen:.1e} | {cut:.1e} | {mirrored:.1e} |")


if __name__ == "__main__":
    main()
