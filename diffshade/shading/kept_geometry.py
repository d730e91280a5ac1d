"""A surface that can be shaded: a G-buffer, and what of its geometry is kept from call to call."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, PyTree, Shaped

from diffshade.buckets import are_at_hand, cut, pad
from diffshade.fusion import Led
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.visible import check_visible
from diffshade.reflectance.material import Material, with_padded_maps
from diffshade.scene import Scene
from diffshade.shading.one_light import Seen, angles

__all__ = ["KeptGeometry", "keep_geometry", "kinds", "planes_of"]


class KeptGeometry(eqx.Module):
    """A G-buffer with the angles under which its points see each light of a scene.

    It stands for the G-buffer in `render` and `mean_squared_error` while positions, normals and the
    directions of lights stay as they are: what may change are coefficients, shapes of lobes and body,
    intensities and the constants of attenuations; not the cone of a spot light, nor the harmonics of an
    environment, nor what is visible of a light. It takes for each light a plane for n.l, one for the
    distance, and one a lobe, four of microfacets. What is rendered from it has no derivative in
    positions, directions and shadows of the scene that it is rendered with: keep it anew where these
    change, inside what is differentiated.
    """

    gbuffer: GBuffer
    angles: tuple[Seen, ...] | None
    kinds: tuple[str, ...] = eqx.field(static=True, default=())

    def in_bucket(self) -> "KeptGeometry":
        """The same, padded."""
        return KeptGeometry(self.gbuffer.in_bucket(), pad(self.angles), self.kinds)

    @property
    def pixel_count(self) -> int:
        """How many foreground pixels there are."""
        return self.gbuffer.pixel_count

    @property
    def foreground(self) -> int:
        """The same: see `Sharded`."""
        return self.pixel_count

    def from_image(self, image: Shaped[Array, "H W C"]) -> Shaped[Array, "C P"]:
        """The foreground of an image [H, W, C], one plane a channel."""
        return self.gbuffer.from_image(image)


def planes_of(surface: KeptGeometry) -> PyTree:
    """Which of a surface's arrays are planes over the pixels: all but the eye's."""
    everything = jax.tree.map(lambda _: True, surface)
    viewer = jax.tree.map(lambda _: False, surface.gbuffer.viewer)
    return eqx.tree_at(lambda s: s.gbuffer.viewer, everything, viewer)


def kinds(scene: Scene, material: Material) -> tuple[str, ...]:
    """The kinds of lights, lobes and body, in order."""
    body = () if material.body is None else (material.body,)
    parts = (*scene.lights, *material.specular, *body)

    def kind(part: Any) -> str:
        weighted = "weighted " * (getattr(part, "weight", None) is not None)
        shadowed = "shadowed " * (getattr(part, "visible", None) is not None)
        return weighted + shadowed + type(part).__name__

    return tuple(map(kind, parts))


def keep_geometry(
    gbuffer: GBuffer, scene: Scene, material: Material | Sequence[Material]
) -> KeptGeometry:
    """The geometry of a G-buffer under a scene's lights, computed once for many renders.

    n.l, the distance where a light has an attenuation, and what each of the material's lobes needs
    (log r.v of `Phong`, log n.h of `BlinnPhong`); not its coefficients. Render it with lights at the
    same places, and lobes of the same kinds. Differentiable in positions, normals and lights.

    Raises `BadInput` for a point light or an eye with a G-buffer that has no positions.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene, material = ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)
    >>> ds.render(keep_geometry(g, scene, material), scene, material).shape
    (8, 8, 1)
    """
    check_visible(scene.lights, gbuffer.point_count)
    if not isinstance(material, Material):
        material = material[0]  # those of one object have the same lobes
    if are_at_hand((gbuffer, scene, material)):
        more = gbuffer.in_bucket(), scene.in_bucket(), with_padded_maps(material)
        seen = cut(_angles.outermost(*more), gbuffer.point_count)
    else:
        seen = _angles(gbuffer, scene, material)
    return KeptGeometry(gbuffer, seen, kinds(scene, material))


@Led
def _angles(gbuffer: GBuffer, scene: Scene, material: Material) -> tuple[Seen, ...]:
    return tuple(angles(gbuffer, light, material.specular, material.body) for light in scene.lights)
