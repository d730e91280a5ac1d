"""From a G-buffer, a scene and a material to an image."""

from collections.abc import Callable, Sequence
from functools import cache

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from diffshade.arrays import is_concrete, is_outermost
from diffshade.channels import Channels
from diffshade.errors import BadInput
from diffshade.fusion import compiler_options
from diffshade.geometry.gbuffer import GBuffer
from diffshade.reflectance.material import Material, by_slot
from diffshade.scene import Scene
from diffshade.shading.basis import basis, contract

__all__ = ["render"]


def render(
    gbuffer: GBuffer, scene: Scene, material: Material | Sequence[Material]
) -> Float[Array, "H W C"]:
    """The image I = I_a k_a + sum_j I_j f(d_j) [k_d n.l_j + k_s (r_j.v)^n] (LIGHT-13).

    Linear radiance [H, W, C] in the unit of the lights' intensities, background 0; C is the number
    of channels of lights and coefficients. A surface with several materials takes a sequence of
    them, numbered by `gbuffer.slot`. What scene or material lack is not computed.

    It nests in `jit`, `grad`, `vmap` and `scan`, and every derivative is exact, for every input, in
    forward and reverse mode. Called outermost with concrete arrays it compiles with the best
    options for the platform. Not smooth where n.l = 0, r.v = 0 and where an attenuation is clamped.

    Raises `BadInput` for numbers of channels that do not match, a point light or an eye with a
    G-buffer that has no positions, and a sequence of materials with a G-buffer that has no slots.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> ds.render(g, ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)).shape
    (8, 8, 1)
    """
    one = _one_material(gbuffer, material)
    _check_maps(gbuffer, one)
    arguments = (gbuffer, scene, one)
    outermost = is_outermost() and is_concrete(arguments)
    return (_render_outermost if outermost else _render)(*arguments)


def _one_material(gbuffer: GBuffer, material: Material | Sequence[Material]) -> Material:
    if isinstance(material, Material):
        return material
    if not material:
        raise BadInput("no materials are given: give one, or one a slot")
    if len(material) == 1:
        return material[0]
    if gbuffer.slot is None:
        raise BadInput(
            f"{len(material)} materials for a surface that has one: give one material, or a mesh"
            " whose faces have slots"
        )
    return by_slot(material, gbuffer.slot)


def _check_maps(gbuffer: GBuffer, material: Material) -> None:
    maps = [leaf.shape for leaf in jax.tree.leaves(material) if leaf.ndim == 2]
    if maps and gbuffer.spread is not None:
        raise BadInput(
            "a material has maps over pixels, and this G-buffer is shaded once a face or a vertex:"
            " use PhongShading()"
        )
    for shape in maps:
        if shape[1] != gbuffer.pixel_count:
            raise BadInput(
                f"a coefficient has shape {shape}: a map is [C or 1, P], P = {gbuffer.pixel_count}"
                " foreground pixels (GBuffer.from_image makes one of an image)"
            )


def _planes(gbuffer: GBuffer, scene: Scene, material: Material) -> Channels:
    planes = contract(basis(gbuffer, scene, material), material)
    dark = jnp.zeros(gbuffer.pixel_count, gbuffer.normal.x.dtype)
    return tuple(plane + dark for plane in planes) or (dark,)


@jax.jit
def _render(gbuffer: GBuffer, scene: Scene, material: Material) -> Float[Array, "H W C"]:
    return gbuffer.to_image(_planes(gbuffer, scene, material))


def _render_outermost(gbuffer: GBuffer, scene: Scene, material: Material) -> Float[Array, "H W C"]:
    return _to_image(gbuffer, _planes_jit()(gbuffer, scene, material))


@cache
def _planes_jit() -> Callable[[GBuffer, Scene, Material], Channels]:
    return jax.jit(_planes, compiler_options=compiler_options())


_to_image = jax.jit(GBuffer.to_image)
