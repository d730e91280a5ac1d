"""The pictures of a course on shading, one call each: arrays with titles, to be shown with anything.

Titles hold mathematics between dollar signs, as Matplotlib and Markdown read it. Nothing here is
drawn: an image is linear radiance [H, W, C], as `render` gives it.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffshade import guard
from diffshade.arrays import ArrayLike, floats, optional
from diffshade.errors import BadInput
from diffshade.geometry.gbuffer import GBuffer
from diffshade.light.base import AbstractRayLight
from diffshade.light.parallel import ParallelLight
from diffshade.reflectance.lobe import AbstractLobe
from diffshade.reflectance.material import Material
from diffshade.reflectance.names import coefficient, coefficient_names, of_every_lobe
from diffshade.reflectance.phong import Phong
from diffshade.scene import Scene
from diffshade.shading.render import render
from diffshade.vector import Vec3, dot, reflect

__all__ = [
    "Picture",
    "composition",
    "cosine_powers",
    "cross_section",
    "direction",
    "highlight_angle",
    "light_by_light",
    "lit_from",
    "vary",
]

SYMBOLS = {
    "ka": "k_a",
    "kd": "k_d",
    "ks": "k_s",
    "shininess": "n",
    "od": "O_d",
    "os": "O_s",
    "alpha": r"\alpha",
    "index": r"\eta",
    "extinction": r"\kappa",
    "f0": "F_0",
}
"""Coefficients as the texts write them."""


class Picture(NamedTuple):
    """An image and what to write above it."""

    title: str
    image: Float[Array, "H W C"]


def composition(gbuffer: GBuffer, scene: Scene, material: Material) -> list[Picture]:
    """Ambient, then with diffuse, then with specular reflection: LIGHT-13 term by term.

    What a picture lacks is left out of the program, not multiplied by zero. A term that scene or
    material lack has no picture; the last picture is the whole render.

    >>> import diffshade as ds
    >>> ball = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene = ds.Scene(ambient=0.2, lights=ds.ParallelLight((0, 0, 1)))
    >>> [title for title, image in composition(ball, scene, ds.Material(ka=0.5, kd=0.5))]
    ['ambient', 'ambient + diffuse']
    """
    lit = bool(scene.lights)
    matte = replace(material, specular=())
    dull = replace(matte, kd=None, body=None)
    terms = (
        ("ambient", scene.ambient is not None and material.ka is not None, dull),
        ("diffuse", lit and material.kd is not None, matte),
        ("specular", lit and bool(material.specular), material),
    )
    pictures: list[Picture] = []
    names: list[str] = []
    for name, present, so_far in terms:
        if present:
            names.append(name)
            pictures.append(Picture(" + ".join(names), render(gbuffer, scene, so_far)))
    return pictures


def light_by_light(gbuffer: GBuffer, scene: Scene, material: Material) -> list[Picture]:
    """The ambient light alone, each light alone, and last all together, which is their sum.

    >>> import diffshade as ds
    >>> ball = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene = ds.Scene(lights=(ds.ParallelLight((1, 0, 1)), ds.ParallelLight((0, 1, 1))))
    >>> [title for title, image in light_by_light(ball, scene, ds.Material(kd=0.5))]
    ['light 1', 'light 2', 'all together']
    """
    alone = [(f"light {k}", Scene(lights=(light,))) for k, light in enumerate(scene.lights, 1)]
    if scene.ambient is not None and material.ka is not None:
        alone.insert(0, ("ambient light", Scene(ambient=scene.ambient)))
    return [
        Picture(title, render(gbuffer, part, material))
        for title, part in [*alone, ("all together", scene)]
    ]


def vary(
    gbuffer: GBuffer, scene: Scene, material: Material, name: str, values: Iterable[ArrayLike]
) -> list[Picture]:
    """The effect of one coefficient: a picture for each of its values, all else as it is.

    `name` is one that `fitting.fit` uses: "ka", "kd", "specular.ks", "specular.shininess" (of every
    lobe), "specular.0.ks" (of one), or "od", "os". Raises `BadInput` for a name that the material
    lacks: a coefficient that is None is a term that is absent, and has no value to vary.

    >>> import diffshade as ds
    >>> ball = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> scene = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    >>> [title for title, image in vary(ball, scene, ds.Material(kd=0.5), "kd", (0.2, 0.8))]
    ['$k_d = 0.2$', '$k_d = 0.8$']
    """
    where = _coefficients(material, name)
    field = name.rpartition(".")[2]
    symbol = SYMBOLS.get(field, field)
    pictures = []
    for number in map(floats(name), values):
        changed = eqx.tree_at(where, material, replace_fn=lambda _: number)  # noqa: B023
        pictures.append(Picture(f"${symbol} = {_brief(number)}$", render(gbuffer, scene, changed)))
    return pictures


def cosine_powers(exponents: ArrayLike, angles: ArrayLike) -> Float[Array, "N A"]:
    """max(0, cos alpha)^n, the fall-off of LIGHT-5: a row for each exponent n >= 0.

    `angles` are in radians, between the mirror direction r and the viewer. Not smooth at a right
    angle, beyond which it is 0.

    >>> cosine_powers([1, 2], [0.0, np.pi / 3]).round(4).tolist()
    [[1.0, 0.5], [1.0, 0.25]]
    """
    n = jnp.atleast_1d(floats("exponents")(exponents))
    alpha = jnp.atleast_1d(floats("angles")(angles))
    return guard.power(jnp.cos(alpha)[None, :], n[:, None])


def cross_section(
    lobe: AbstractLobe, incidence: ArrayLike, angles: ArrayLike, *, across: bool = False
) -> Float[Array, "A"]:
    """The radiance k_s s of a lobe in the plane of incidence, under a light of strength 1.

    The light comes in at `incidence` from the normal, and `angles` are those of the viewer, positive
    on the other side, where the mirror direction is at `incidence`; all in radians. With `across` the
    viewer turns out of the plane instead, by `angles` from the mirror direction. Raises `BadInput`
    for a lobe with more than one channel. Not smooth where the lobe is cut off.

    >>> from diffshade.reflectance.phong import Phong
    >>> cross_section(Phong(0.5, 2), 0.5, [0.5, 0.5 + np.pi / 3]).round(4).tolist()
    [0.5, 0.125]
    """
    i, a = floats("incidence")(incidence), jnp.atleast_1d(floats("angles")(angles))
    zero, one = jnp.zeros_like(a), jnp.ones_like(a)
    normal = Vec3(zero, zero, one)
    to_light = Vec3(-jnp.sin(i) * one, zero, jnp.cos(i) * one)
    view = Vec3(jnp.sin(a), zero, jnp.cos(a))
    if across:
        view = Vec3(jnp.sin(i) * jnp.cos(a), jnp.sin(a), jnp.cos(i) * jnp.cos(a))
    shape = lobe.shape(normal, to_light, view, to_light.z)
    if lobe.ks.ndim or len(shape) > 1:
        raise BadInput("the lobe has more than one channel: give one with a number for each")
    return lobe.ks * shape[0]


def direction(azimuth: ArrayLike, elevation: ArrayLike) -> Float[Array, "3"]:
    """The unit vector at angles in radians: to the right of the viewer, and up from the horizon.

    Both zero is the viewer's own direction, +z: (cos e sin a, sin e, cos e cos a).

    >>> direction(0.0, 0.0).tolist()
    [0.0, 0.0, 1.0]
    """
    a, e = floats("azimuth")(azimuth), floats("elevation")(elevation)
    return jnp.stack([jnp.cos(e) * jnp.sin(a), jnp.sin(e), jnp.cos(e) * jnp.cos(a)])


def highlight_angle(gbuffer: GBuffer, scene: Scene) -> Float[np.ndarray, "H W"]:
    """How far each pixel lies from a highlight: the angle between viewer and mirrored light (LIGHT-10).

    In radians, [0, pi], of the nearest of several lights, and whether or not the light is behind the
    surface; 0 in the background. Computed on the host, in the G-buffer's precision. Light from all
    around (`EnvironmentLight`) has no mirror direction. Raises `BadInput` for a scene of no other.

    >>> import diffshade as ds
    >>> ball = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(9, 9, 2.2))
    >>> float(highlight_angle(ball, ds.Scene(lights=ds.ParallelLight((0, 0, 1))))[4, 4])
    0.0
    """
    lights = [light for light in scene.lights if isinstance(light, AbstractRayLight)]
    if not lights:
        raise BadInput(
            "the scene has no lights with a direction: there is no highlight to be far from"
        )
    n, v = gbuffer.normal, gbuffer.viewer.direction(gbuffer.position)
    cosines = [
        np.asarray(dot(reflect(light.incidence(gbuffer.position).l, n), v)) for light in lights
    ]
    angle = np.arccos(np.clip(np.max(cosines, axis=0), -1, 1))
    return np.asarray(gbuffer.placed(angle[:, None]))[..., 0]


def lit_from(
    gbuffer: GBuffer,
    *,
    ka: ArrayLike,
    kd: ArrayLike,
    ks: ArrayLike,
    shininess: ArrayLike,
    azimuth: ArrayLike,
    elevation: ArrayLike,
    ambient: ArrayLike = 1.0,
    intensity: ArrayLike = 1.0,
    od: ArrayLike | None = None,
) -> Float[Array, "H W C"]:
    """A glossy surface under one parallel light from a `direction` in radians: what sliders move.

    Every number is an argument of one compiled program, so that dragging never compiles again.

    >>> import diffshade as ds
    >>> ball = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.4))
    >>> lit_from(ball, ka=0.1, kd=0.5, ks=0.4, shininess=20, azimuth=0.3, elevation=0.5).shape
    (8, 8, 1)
    """
    light = ParallelLight(direction(azimuth, elevation), floats("intensity")(intensity))
    lobe = Phong(floats("ks")(ks), floats("shininess")(shininess))
    material = Material(floats("ka")(ka), floats("kd")(kd), (lobe,), optional(floats("od"))(od))
    return render(gbuffer, Scene(floats("ambient")(ambient), (light,)), material)


def _coefficients(material: Material, name: str) -> Callable[[Material], list[Array]]:
    """Where the coefficients of a name are in a material."""
    known = coefficient_names(material)
    chosen = [full for full in known if name in (full, of_every_lobe(full))]
    if not chosen:
        raise BadInput(
            f"the coefficient to vary is {name!r}, which this material lacks: it has"
            f" {', '.join(known) or 'none'}"
        )
    return lambda material: [coefficient(material, full) for full in chosen]


def _brief(value: Float[Array, "..."]) -> str:
    numbers = ", ".join(f"{number:g}" for number in np.ravel(value)[:4])
    return f"({numbers}{', ...' if np.size(value) > 4 else ''})" if np.ndim(value) else numbers
