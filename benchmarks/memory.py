"""Memory beyond input and output, by the compiler's own plan: 2,048 x 2,048, 16 RGB lights, float32."""

from typing import Any

import jax

import diffshade as ds
from benchmarks.figures import Figure, ask
from benchmarks.scenes import Case, ours, perspective
from diffshade.shading.image import image_planes
from diffshade.shading.kept_geometry import KeptGeometry

__all__ = ["figures", "run"]

MIB = 2**20


def measure() -> dict[str, Any]:
    """MiB of a forward pass, and of a value with its gradient in coefficients and lights."""
    case = Case(size=2048, lights=16)
    gbuffer, scene, material = ours(case, perspective(case))
    observed = jax.ShapeDtypeStruct((3, gbuffer.pixel_count), gbuffer.normal.x.dtype)
    options = ds.compiler_options()

    def planes(g: Any, scene: Any, material: Any) -> Any:
        return image_planes(KeptGeometry(g, None), scene, material, plain=False)

    def step(g: Any, scene: Any, material: Any, observed: Any) -> Any:
        return jax.value_and_grad(ds.mean_squared_error, (1, 2))(g, scene, material, observed)

    def beyond(f: Any, *arguments: Any) -> float:
        program = jax.jit(f, compiler_options=options).lower(*arguments).compile()
        return float(program.memory_analysis().temp_size_in_bytes / MIB)

    return {
        "forward": beyond(planes, gbuffer, scene, material),
        "value and gradient": beyond(step, gbuffer, scene, material, observed),
    }


def run() -> dict[str, Any]:
    """As one processor plans it, and several."""
    return {f"{cores} cores": ask("memory", cores=cores) for cores in (1, 2)}


def figures(results: dict[str, Any]) -> list[Figure]:
    """MiB; a plan does not vary."""
    return [
        Figure(f"{what}, {cores}", value, "MiB", most=32, tolerance=0.05)
        for cores, found in results.items()
        for what, value in found.items()
    ]
