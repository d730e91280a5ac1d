"""A surface whose pixels are dealt out over devices, and programs that each runs on its own of them.

Left to XLA, a loop over pages of planes that are dealt out gathers the planes on every device: pages
are cut by numbers that it does not know. Here each device goes through the pages of its own pixels.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Bool, PyTree, Shaped

from diffshade.arrays import is_concrete
from diffshade.devices import AXIS, Devices, dealt, mesh_over, place
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.shading.kept_geometry import KeptGeometry, planes_of

__all__ = ["Sharded", "on_each", "shard"]

T = TypeVar("T")


class Sharded(eqx.Module):
    """A G-buffer, or kept geometry, whose pixels are dealt out over devices: see `shard`.

    Every device has as many pixels. Where that takes a few more than there are, the last is repeated,
    with an index beyond the image. `pixel_count` counts them too: planes, and maps of coefficients,
    have that length, as `from_image` makes them.
    """

    surface: KeptGeometry
    mesh: Mesh = eqx.field(static=True)
    foreground: int = eqx.field(static=True)

    @property
    def gbuffer(self) -> GBuffer:
        """The G-buffer, on the devices."""
        return self.surface.gbuffer

    @property
    def pixel_count(self) -> int:
        """How many pixels the devices have together."""
        return self.surface.pixel_count

    def from_image(self, image: Shaped[Array, "H W C"]) -> Shaped[Array, "C P"]:
        """The pixels of an image [H, W, C], one plane a channel, dealt out like the G-buffer's.

        Raises `BadInput` for an image of another size.
        """
        height, width = self.gbuffer.shape
        if image.shape[:2] != (height, width):
            raise BadInput(f"the image has shape {image.shape}: give [{height}, {width}, C]")
        assert self.gbuffer.index is not None
        index = jnp.minimum(self.gbuffer.index, self.gbuffer.index[self.foreground - 1])
        return image.reshape(-1, image.shape[-1]).T[:, index]

    def counted(self) -> Bool[Array, "P"] | None:
        """Which pixels are not repeated ones; None where none is."""
        if self.pixel_count == self.foreground:
            return None
        height, width = self.gbuffer.shape
        assert self.gbuffer.index is not None
        return self.gbuffer.index < height * width


def shard(surface: GBuffer | KeptGeometry, devices: Devices) -> Sharded:
    """The surface with its pixels dealt out over devices, for `render` and `mean_squared_error`.

    `devices` is a sequence of JAX devices, or a `jax.sharding.Mesh` with one axis. Each device shades
    its own P / devices pixels, and of a loss only the sums are added up; values and derivatives are
    those of one device, to the order of sums. Scenes and materials are on all of them. An image that
    is compared again and again is best dealt out once, by `Sharded.from_image`. `render` gathers the
    pixels, for an image is one array.

    Raises `BadInput` for devices that are none, or given twice, and for a mesh that is shaded once a
    face or a vertex.

    >>> import diffshade as ds
    >>> g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene, material = ds.Scene(lights=ds.ParallelLight((0, 0, 1))), ds.Material(kd=0.5)
    >>> ds.render(ds.shard(g, jax.devices()), scene, material).shape
    (8, 8, 1)
    """
    if isinstance(surface, Sharded) or not is_concrete(surface):
        raise BadInput(
            "a surface is dealt out over devices once, outside of jit, grad and vmap: give ds.shard a"
            " G-buffer, or kept geometry, of values"
        )
    mesh = mesh_over(devices)
    kept = surface if isinstance(surface, KeptGeometry) else KeptGeometry(surface, None)
    gbuffer = kept.gbuffer
    if gbuffer.spread is not None:
        raise BadInput(
            "this G-buffer is shaded once a face or a vertex, which many pixels share: use"
            " PhongShading() to deal its pixels out over devices"
        )
    if not gbuffer.pixel_count:
        raise BadInput("the G-buffer has no foreground pixel: there is nothing to deal out")
    count, image = gbuffer.pixel_count, gbuffer.shape[0] * gbuffer.shape[1]
    repeated = -count % mesh.size
    index = np.arange(image) if gbuffer.index is None else np.asarray(gbuffer.index)
    beyond = image + np.arange(repeated)
    index = np.concatenate([index, beyond]).astype(np.int32)

    def longer(x: Any, plane: bool) -> Any:
        return np.pad(np.asarray(x), (0, repeated), mode="edge") if plane else x

    planes = planes_of(kept)
    padded = jax.tree.map(longer, kept, planes)
    whole = eqx.tree_at(lambda s: s.gbuffer.index, padded, index, is_leaf=lambda x: x is None)
    return Sharded(place(whole, mesh, dealt(whole, planes_of(whole))), mesh, count)


def on_each(f: Callable[..., T], mesh: Mesh, arguments: tuple[Any, ...], planes: PyTree) -> T:
    """f(*arguments) on every device's part of the `planes` among the arguments.

    What it gives is joined along the last axis. Nothing is sent: a derivative in what all devices share
    is added up once, at its end.
    """
    # Loops over pages start from zeros, which JAX would have to be told are each device's own.
    return jax.shard_map(
        f,
        mesh=mesh,
        in_specs=dealt(arguments, planes),
        out_specs=PartitionSpec(AXIS),
        check_vma=False,
    )(*arguments)
