"""Shading once a face, a vertex or a pixel: run time against error, as a ball's mesh is refined.

    python -m benchmarks.frequency        prints the tables, and draws frequency.png (extra `notebook`)

Icospheres of 80 to 81,920 triangles, with the ball's own normals at their vertices, fill an image of
512 x 512 pixels under four coloured point lights, beside the ball itself, whose every pixel is shaded.
Errors are in parts of the brightest pixel: over the pixels that see both within nine tenths of the
outline's radius, and over those further out (the rim), where normals turn away faster than pixels
follow; which pixels see the mesh at all is the same for every frequency. Times are CPU time on one
core, medians over rounds in which all take their turn, each beside the ball's of that round. The
G-buffer is what has to be done once for a mesh that stands still: casting rays at new triangles, and
interpolating positions and normals.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import trimesh

import diffshade as ds
from benchmarks.figures import ROOT, ask, in_turn, median, paired_ratio
from benchmarks.scenes import Case, ours
from diffshade.geometry.frequency import AbstractFrequency

__all__ = ["figure", "measure"]

SIZE, EXTENT, INTERIOR = 512, 2.2, 0.9
LEVELS = (1, 2, 3, 4, 5, 6)
LIGHTS = (1, 4, 16)
ROUNDS, BUILDS = 31, 7
BALL = "ball"
FREQUENCIES = {
    "flat": ds.FlatShading(),
    "Gouraud": ds.GouraudShading(),
    "Phong": ds.PhongShading(),
}

Result = dict[str, Any]


def materials(glossy: ds.Material) -> dict[str, ds.Material]:
    """The same body without and with its highlight."""
    return {"matte": ds.Material(ka=glossy.ka, kd=glossy.kd), "glossy": glossy}


def icosphere(level: int) -> ds.Mesh:
    """20 * 4**level triangles in new arrays: nothing of them is remembered."""
    ball = trimesh.creation.icosphere(subdivisions=level)
    vertices = jnp.array(ball.vertices, jnp.float32)
    return ds.Mesh(vertices, jnp.array(ball.faces), normals=jnp.array(vertices))


def seen(mesh: ds.Mesh, shading: AbstractFrequency) -> ds.GBuffer:
    """Its G-buffer."""
    return ds.gbuffer(mesh, ds.OrthographicCamera(SIZE, SIZE, EXTENT), shading=shading)


def errors(image: np.ndarray, exact: np.ndarray, both: np.ndarray) -> dict[str, float]:
    """Beside the ball, in parts of its brightest pixel."""
    row, column = np.indices((SIZE, SIZE)) + 0.5
    inner = np.hypot(row - SIZE / 2, column - SIZE / 2) * EXTENT / SIZE < INTERIOR
    off = np.abs(image - exact) / exact.max()
    return {
        "largest": float(off[both & inner].max()),
        "rms": float(np.sqrt((off[both & inner] ** 2).mean())),
        "rim": float(off[both & ~inner].max()),
    }


def silhouette(mesh: np.ndarray, ball: np.ndarray) -> tuple[float, float]:
    """Pixels that see one of the two alone: over those of the ball, and over those of its outline."""
    padded = np.pad(ball, 1)
    inside = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    outline = ball & ~inside
    return float((mesh ^ ball).sum() / ball.sum()), float((mesh ^ ball)[outline].mean())


def measure() -> Result:
    """Everything, in this process."""
    ball, scene, glossy = ours(Case(size=SIZE))
    surfaces = {
        (name, level): seen(icosphere(level), frequency)
        for level in LEVELS
        for name, frequency in FREQUENCIES.items()
    }
    images = []
    for finish, material in materials(glossy).items():
        exact = np.asarray(ds.render(ball, scene, material))
        calls = {case: _rendered(g, scene, material) for case, g in surfaces.items()}
        calls[BALL, 0] = _rendered(ball, scene, material)
        times = in_turn(calls, ROUNDS, time.process_time)
        own = times[BALL, 0]
        for (name, level), seconds in times.items():
            ms = 1e3 * median(own) * paired_ratio(seconds, own)  # round by round, beside the ball
            point = {"finish": finish, "name": name, "level": level, "ms": ms}
            if name != BALL:
                image = np.asarray(calls[name, level]())
                point |= errors(image, exact, surfaces[name, level].mask & ball.mask)
            images.append(point)
    outlines = {level: silhouette(surfaces["flat", level].mask, ball.mask) for level in LEVELS}
    return {
        "images": images,
        "silhouettes": [(level, *shares) for level, shares in outlines.items()],
        "gbuffers": _gbuffers(),
        "lights": [(count, *_by_lights(count)) for count in LIGHTS],
    }


def _rendered(g: ds.GBuffer, scene: ds.Scene, material: ds.Material) -> Callable[[], Any]:
    return lambda: ds.render(g, scene, material).block_until_ready()


def _gbuffers() -> list[tuple[str, int, float]]:
    """Milliseconds of a G-buffer of a mesh never seen before, the making of its arrays apart."""

    def build(level: int, frequency: AbstractFrequency) -> float:
        mesh = icosphere(level)
        jnp.asarray(mesh.vertices).block_until_ready()
        before = time.process_time()
        found = seen(mesh, frequency)
        found.normal.x.block_until_ready()
        return time.process_time() - before

    cases = [(level, name) for level in LEVELS for name in FREQUENCIES]
    for level, name in cases:  # compiles
        build(level, FREQUENCIES[name])
    times: dict[tuple[int, str], list[float]] = {case: [] for case in cases}
    for _ in range(BUILDS):
        for level, name in cases:
            times[level, name].append(build(level, FREQUENCIES[name]))
    return [(name, level, 1e3 * median(seconds)) for (level, name), seconds in times.items()]


def _by_lights(count: int, level: int = 4) -> list[float]:
    """Times over that of the ball, matte and then glossy, of each frequency."""
    ball, scene, glossy = ours(Case(size=SIZE, lights=count))
    ratios = []
    for material in materials(glossy).values():
        calls = {
            name: _rendered(seen(icosphere(level), frequency), scene, material)
            for name, frequency in FREQUENCIES.items()
        }
        calls[BALL] = _rendered(ball, scene, material)
        times = in_turn(calls, ROUNDS, time.process_time)
        ratios += [paired_ratio(times[name], times[BALL]) for name in FREQUENCIES]
    return ratios


def tables(results: Result) -> str:
    """All of it as Markdown."""
    built = {(name, level): ms for name, level, ms in results["gbuffers"]}
    lines = []
    for finish in ("matte", "glossy"):
        points = [p for p in results["images"] if p["finish"] == finish]
        (own,) = (p["ms"] for p in points if p["name"] == BALL)
        lines += [f"\n{finish}; the ball itself, a pixel each: {own:.1f} ms\n"]
        lines += ["| shaded | triangles | ms | G-buffer, ms | RMS | largest | at the rim |"]
        lines += ["|---|---|---|---|---|---|---|"]
        for p in sorted((p for p in points if p["name"] != BALL), key=_order):
            cells = (p["name"], f"{20 * 4 ** p['level']:,}", f"{p['ms']:.1f}")
            cells += (f"{built[p['name'], p['level']]:.1f}",)
            cells += tuple(f"{p[key]:.1e}" for key in ("rms", "largest", "rim"))
            lines.append("| " + " | ".join(cells) + " |")
    lines += ["\n| triangles | pixels of the ball that differ | of its outline |", "|---|---|---|"]
    for level, of_ball, of_outline in results["silhouettes"]:
        lines.append(f"| {20 * 4**level:,} | {of_ball:.2%} | {of_outline:.0%} |")
    heads = [f"{finish}, {name}" for finish in ("matte", "glossy") for name in FREQUENCIES]
    lines += ["\n5,120 triangles, times over that of the ball\n"]
    lines += [f"| lights | {' | '.join(heads)} |", "|---" * (1 + len(heads)) + "|"]
    for count, *ratios in results["lights"]:
        lines.append(f"| {count} | " + " | ".join(f"{ratio:.2f}" for ratio in ratios) + " |")
    return "\n".join(lines)


def _order(point: Result) -> tuple[int, int]:
    return [*FREQUENCIES].index(point["name"]), point["level"]


def figure(results: Result, file: Path) -> None:
    """Error against run time: of a mesh that stands still above, with its G-buffer below."""
    from matplotlib.figure import Figure

    built = {(name, level): ms for name, level, ms in results["gbuffers"]}
    drawing = Figure(figsize=(11, 8), layout="constrained")
    grid = drawing.subplots(2, 2, sharey=True)
    for (row, still), (column, finish) in (
        (row, column)
        for row in enumerate((True, False))
        for column in enumerate(("matte", "glossy"))
    ):
        axes = grid[row, column]
        points = [p for p in results["images"] if p["finish"] == finish]
        for name, marker, colour in zip(FREQUENCIES, "osD", ("C0", "C1", "C2"), strict=True):
            own = sorted((p for p in points if p["name"] == name), key=_order)
            more = [0.0 if still else built[name, p["level"]] for p in own]
            x = [p["ms"] + extra for p, extra in zip(own, more, strict=True)]
            axes.plot(x, [p["rms"] for p in own], marker + "-", color=colour, label=f"{name}, RMS")
            axes.plot(x, [p["largest"] for p in own], ":", color=colour, label="largest")
            for end in (0, -1):
                label, place = f"{20 * 4 ** own[end]['level']:,}", (x[end], own[end]["rms"])
                axes.annotate(label, place, fontsize=8, xytext=(5, 4), textcoords="offset points")
        if still:
            (ball,) = (p["ms"] for p in points if p["name"] == BALL)
            axes.axvline(ball, color="0.6", linewidth=1, label="the ball itself: no error")
        what = "a mesh that stands still" if still else "a new mesh, with its G-buffer"
        axes.set(yscale="log", title=f"{finish}: {what}")
        axes.set(xlabel="run time, milliseconds", ylabel="error / brightest pixel")
        axes.set_xlim(0, None)
        axes.grid(which="major", color="0.9")
    grid[0, 0].legend(fontsize=8, loc="lower left")
    drawing.suptitle(
        f"A ball of {20 * 4 ** LEVELS[0]} to {20 * 4 ** LEVELS[-1]:,} triangles, {SIZE} x {SIZE}"
        " pixels, four lights: error against run time"
    )
    drawing.savefig(file, dpi=100)


def main() -> None:
    """Measure, print, draw."""
    results = ask("frequency", cores=1)
    print(tables(results))
    file = ROOT / "benchmarks" / "frequency.png"
    figure(results, file)
    print(f"\nwrote {file.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
