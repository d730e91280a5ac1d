"""What the contract of a public function computes of a case: one pixel, one formula, one mesh."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import strategies
from strategies import Cases, Deck

import diffshade as ds
from diffshade import guard, vector
from diffshade.colour import cie, interpolate, metamer, observer, spectrum
from diffshade.geometry import normals
from diffshade.geometry.surface import Visibility
from diffshade.harmonics import bands, spherical_harmonics
from diffshade.reflectance import masking
from diffshade.vector import Vec3


class Contract(NamedTuple):
    """How the cases are made, and what is computed of one."""

    make: Callable[[Deck], Cases]
    of: Callable[[dict[str, Any]], Any]

    def cases(self, deck: Deck) -> Cases:
        """Those numbers of a case that the computation reads."""
        case = self.make(deck)
        one = {name: jax.ShapeDtypeStruct(x.shape[1:], x.dtype) for name, x in case.items()}
        read: set[str] = set()
        jax.eval_shape(lambda one: self.of(_Noted(one, read)), one)
        return {name: case[name] for name in sorted(read)}


class _Noted(dict[str, Any]):
    """A case that notes what is read of it."""

    def __init__(self, case: Any, read: set[str]) -> None:
        super().__init__(case)
        self.read = read

    def __getitem__(self, name: str) -> Any:
        self.read.add(name)
        return super().__getitem__(name)


def gbuffer(case: dict[str, Any], eye: bool = True) -> ds.GBuffer:
    """One pixel."""
    position, normal = case["position"][None, None], case["normal"][None, None]
    viewer = {"eye": case["eye"]} if eye else {"view": case["view"]}
    return ds.GBuffer.from_arrays(position, normal, np.ones((1, 1), bool), **viewer)


def law(kind: type[Any] | None, case: dict[str, Any]) -> Any:
    """An attenuation."""
    c, linear = case["c"], case["linear"]
    laws: dict[Any, Callable[[], Any]] = {
        None: lambda: None,
        ds.QuadraticAttenuation: lambda: ds.QuadraticAttenuation(*c),
        ds.LinearAttenuation: lambda: ds.LinearAttenuation(*linear),
        ds.InverseSquare: ds.InverseSquare,
        ds.ExponentialAttenuation: lambda: ds.ExponentialAttenuation(case["a"]),
        ds.Windowed: lambda: ds.Windowed(ds.InverseSquare(), case["reach"]),
    }
    return laws[kind]()


def point_light(case: dict[str, Any], kind: Any = None) -> ds.PointLight:
    """One with an attenuation."""
    return ds.PointLight(case["place"], case["intensity"], law(kind, case))


def parallel_light(case: dict[str, Any]) -> ds.ParallelLight:
    """One towards the same."""
    return ds.ParallelLight(case["direction"], case["intensity"])


def spot_light(case: dict[str, Any]) -> ds.SpotLight:
    """One there that shines the other way."""
    shining = -case["direction"], case["intensity"], case["shininess"]
    return ds.SpotLight(case["place"], *shining, attenuation=law(ds.QuadraticAttenuation, case))


def sky(case: dict[str, Any]) -> ds.EnvironmentLight:
    """An environment of order 2."""
    some = jnp.concatenate([case["intensity"], case["ambient"], -case["intensity"]])
    return ds.EnvironmentLight(jnp.tile(some, 3), case["intensity"])


def glowing(kind: str, case: dict[str, Any]) -> Any:
    """A light with extent there, of one sample along a side, or two."""
    place, side, radiance = case["place"], case["direction"], case["intensity"]
    end = jnp.clip(place + side, -1e6, 1e6)
    emitters: dict[str, Callable[[], Any]] = {
        "Rectangle": lambda: ds.RectangleLight(place, side, jnp.roll(side, 1), radiance, 1),
        "Disc": lambda: ds.DiscLight(place, side, case["reach"], radiance, 1),
        "Sphere": lambda: ds.SphereLight(place, case["reach"], radiance, 1),
        "Line": lambda: ds.LineLight(place, end, radiance, 2),
    }
    return emitters[kind]()


def material(case: dict[str, Any], *lobes: Callable[..., Any]) -> ds.Material:
    """Everything that a material can have."""
    specular = tuple(lobe(case["ks"], case["shininess"]) for lobe in lobes)
    return ds.Material(case["ka"], case["kd"], specular, case["od"], case["os"])


def under_glass(ks: Any, shininess: Any) -> ds.BlinnPhong:
    """A lobe with a weight, whose numbers have the precision in which it is made."""
    return ds.BlinnPhong(ks, shininess, weight=ds.Dielectric(1.3))


def shaded(light: Callable[..., Any], *lobes: Callable[..., Any], eye: bool = True) -> Contract:
    """The radiance of a point under a light."""

    def of(case: dict[str, Any]) -> Any:
        scene = ds.Scene(case["ambient"], light(case))
        return ds.render(gbuffer(case, eye), scene, material(case, *lobes))

    return Contract(strategies.scenes, of)


def faceted(lobe: type[Any], fresnel: Callable[..., Any] | None, **options: Any) -> Contract:
    """A microfacet lobe over a body under the same boundary."""

    def of(case: dict[str, Any]) -> Any:
        scene = ds.Scene(case["ambient"], point_light(case))
        boundary = None if fresnel is None else fresnel(case)
        one = lobe(case["ks"], case["alpha"], boundary, **options)
        body = ds.FresnelBody(case["index"])
        coated = ds.Material(case["ka"], case["kd"], one, case["od"], case["os"], body)
        return ds.render(gbuffer(case), scene, coated)

    return Contract(strategies.scenes, of)


def attenuated(kind: type[Any]) -> Contract:
    """A law at a distance, and what a light of it does."""

    def of(case: dict[str, Any]) -> Any:
        scene = ds.Scene(None, point_light(case, kind))
        image = ds.render(gbuffer(case), scene, ds.Material(kd=case["kd"]))
        return law(kind, case)(case["d"]), image

    return Contract(strategies.scenes, of)


def kept(case: dict[str, Any]) -> Any:
    """From geometry that is kept."""
    scene = ds.Scene(case["ambient"], point_light(case, ds.QuadraticAttenuation))
    of = material(case, ds.Phong)
    return ds.render(ds.keep_geometry(gbuffer(case), scene, of), scene, of)


def from_basis(case: dict[str, Any]) -> Any:
    """The basis, and what is contracted of it."""
    scene = ds.Scene(case["ambient"], point_light(case, ds.QuadraticAttenuation))
    terms = ds.basis(gbuffer(case), scene, material(case, ds.Phong))
    return terms, ds.contract(terms, material(case, ds.Phong))


def error(case: dict[str, Any]) -> jax.Array:
    """The squared error against an observation."""
    scene = ds.Scene(case["ambient"], point_light(case, ds.QuadraticAttenuation))
    observed = case["observed"][None, None]
    return ds.mean_squared_error(gbuffer(case), scene, material(case, ds.Phong), observed)


def on_a_device(case: dict[str, Any]) -> Any:
    """A pixel that is dealt out, which is done with values: the light is what varies."""
    dtype = case["place"].dtype
    ground = np.zeros((1, 1, 3), dtype)
    up = ground + np.array([0, 0, 1], dtype)
    with jax.ensure_compile_time_eval():
        flat = ds.GBuffer.from_arrays(ground, up, eye=np.array([0, 0, 1], dtype))
        dealt = ds.shard(flat, jax.devices()[:1])
    scene = ds.Scene(case["ambient"], point_light(case, ds.QuadraticAttenuation))
    return ds.render(dealt, scene, material(case, ds.Phong))


PIXELS = Visibility((2, 2), jnp.arange(4, dtype=jnp.int32))


def orthographic(case: dict[str, Any]) -> Any:
    """A camera of 2 x 2 pixels."""
    return ds.OrthographicCamera(
        2, 2, case["extent"], position=case["camera"], target=case["target"], up=case["up"]
    )


def perspective(case: dict[str, Any]) -> Any:
    """The same, of a point."""
    return ds.PerspectiveCamera(2, 2, case["fov"], case["camera"], case["target"], case["up"])


def ball(camera: Callable[..., Any], case: dict[str, Any]) -> Any:
    """The points of a sphere that four pixels see, whether or not their rays meet it."""
    g = ds.gbuffer(ds.Sphere(case["center"], case["radius"]), camera(case), PIXELS)
    return g.position, g.normal, g.viewer


def inside(*pixels: bool) -> Visibility:
    """The same pixels, some of which see a surface from inside."""
    return eqx.tree_at(lambda s: s.inside, PIXELS, jnp.array(pixels), is_leaf=lambda x: x is None)


LAYERS = ((inside(False, False, True, False),), (inside(True, True, False, True),))


def both_sides(case: dict[str, Any]) -> Any:
    """The same from both sides."""
    given = ds.Sphere(case["center"], case["radius"]), orthographic(case)
    found = ds.layers(*given, visibility=LAYERS)
    return [(g.position, g.normal) for (g,) in found]


def behind_each_other(kind: type[Any]) -> Contract:
    """A transparent point before another one, before a background."""

    def of(case: dict[str, Any]) -> Any:
        colour = (case["od"],) if kind is ds.FilteredTransparency else ()
        scene = ds.Scene(case["ambient"], point_light(case))
        layers = ((gbuffer(case),), (gbuffer(case),))
        transparency = kind(case["ks"], *colour)
        return ds.render_layers(layers, scene, material(case), transparency, case["observed"])

    return Contract(strategies.captures, of)


FACES = np.array([[0, 1, 2], [0, 2, 3]])


def triangles(frequency: Any, given: bool, case: dict[str, Any]) -> Any:
    """The points at which a mesh is shaded."""
    mesh = ds.Mesh(case["vertices"], FACES, case["normals"] if given else None)
    weights = Vec3(*(jnp.tile(w, 4) for w in case["weights"]))
    face = jnp.array([0, 1, 0, 1], jnp.int32)
    seen = eqx.tree_at(
        lambda s: (s.face, s.barycentric), PIXELS, (face, weights), is_leaf=lambda x: x is None
    )
    g = ds.gbuffer(mesh, orthographic(case), seen, shading=frequency)
    light = ds.ParallelLight(case["up"], jnp.ones_like(case["extent"]))
    matt = ds.Material(kd=jnp.ones_like(case["extent"]))
    return g.position, g.normal, ds.render(g, ds.Scene(lights=light), matt)


def of_corners(f: Callable[..., Any]) -> Contract:
    """A function of a triangle."""

    def of(case: dict[str, Any]) -> Any:
        return f(*(Vec3.from_array(case["vertices"][None, k]) for k in range(3)))

    return Contract(lambda deck: {"vertices": strategies.meshes(deck)["vertices"][:, :3]}, of)


def of_vertices(case: dict[str, Any]) -> Vec3:
    """The normals of vertices."""
    return normals.vertex_normals(case["vertices"], jnp.asarray(FACES))


def of_vectors(f: Callable[..., Any], count: int = 2) -> Contract:
    """A function of one or two vectors."""

    def of(case: dict[str, Any]) -> Any:
        return f(*(Vec3.from_array(case[name]) for name in ("a", "b")[:count]))

    return Contract(strategies.vectors, of)


def of_sphere(case: dict[str, Any]) -> Any:
    """The harmonics in a direction, and sums of them."""
    w, c = vector.unit(Vec3.from_array(case["a"])), jnp.tile(case["b"], 3)[:, None]
    return spherical_harmonics(w, 3), bands(w, c)


def of_numbers(f: Callable[..., Any]) -> Contract:
    """A function of one number."""
    return Contract(lambda deck: {"x": deck.numbers()}, lambda case: f(case["x"]))


def of_inverses(f: Callable[..., Any]) -> Contract:
    """One whose derivatives leave the range of a type for numbers that are no lengths."""

    def cases(deck: Deck) -> Cases:
        x = deck.signs((deck.count,)) * deck.lengths()
        return {"x": deck.either(0.9, x, 0 * x).astype(deck.dtype)}

    return Contract(cases, lambda case: f(case["x"]))


def directions(deck: Deck) -> Cases:
    """Unit vectors n, l, v, with the ties of lights, and a shininess."""
    case = strategies.scenes(deck)
    return {key: case[key] for key in ("position", "normal", "eye", "place", "shininess")}


def lobe(f: Callable[..., Any]) -> Contract:
    """A lobe as a formula."""

    def of(case: dict[str, Any]) -> Any:
        p, n, v, l = (Vec3.from_array(case[k]) for k in ("position", "normal", "eye", "place"))
        n, l, v = vector.unit(n), vector.unit(l - p), vector.unit(v - p)
        return f(n, l, v, vector.dot(n, l), case["shininess"])

    return Contract(directions, of)


def of_angles(f: Callable[..., Any], *names: str) -> Contract:
    """A part of a microfacet model: of cosines in [0, 1], and what it has."""
    return Contract(strategies.materials, lambda case: f(*(case[name] for name in names)))


SMITH = ("cosine", "other cosine", "alpha")


def smith(f: Callable[..., Any]) -> Callable[..., Any]:
    """Smith's masking of GGX's facets."""

    def masked(n_dot_l: Any, n_dot_v: Any, alpha: Any) -> Any:
        return f(n_dot_l, n_dot_v, *(masking.ggx_shadow(c, alpha) for c in (n_dot_l, n_dot_v)))

    return masked


def grooved(deck: Deck) -> Cases:
    """n.l, n.v, n.h and v.h of a facet between two directions at an angle."""
    case = strategies.materials(deck)
    return {name: case[name] for name in ("cosine", "other cosine", "f0")}


def of_grooves(case: dict[str, Any]) -> jax.Array:
    """V-grooves between light and viewer that are as far apart about n as a share says."""
    nl, nv = case["cosine"], case["other cosine"]
    across = guard.sqrt(1 - nl * nl) * guard.sqrt(1 - nv * nv)
    l_dot_v = nl * nv + (2 * case["f0"] - 1) * across
    half = guard.sqrt(0.5 * (1 + l_dot_v))
    return masking.v_groove(nl, nv, jnp.minimum(guard.ratio(0.5 * (nl + nv), half), 1), half)


def refractions(deck: Deck) -> Cases:
    """Directions of light and normal, and an index."""
    return strategies.vectors(deck) | {"index": strategies.materials(deck)["index"]}


def refracted(case: dict[str, Any]) -> Vec3:
    """Where light goes on."""
    l, n = (vector.unit(Vec3.from_array(case[name])) for name in ("a", "b"))
    return vector.refract(l, n, case["index"])


def of_colours(f: Callable[..., Any]) -> Contract:
    """A function of a colour."""
    return Contract(strategies.colours, lambda case: f(case["colour"]))


def of_shares(case: dict[str, Any]) -> jax.Array:
    """Of the components in their sum."""
    return guard.ratio(case["colour"], case["colour"].sum(keepdims=True))


WAVELENGTHS = np.array([450.0, 550.0, 600.0])
"""Of three components as a spectrum."""


def temperatures(deck: Deck) -> Cases:
    """Of the range in which black bodies are computed."""
    return {"kelvin": deck.between(1.0, 1e6)}


def glow(kelvin: jax.Array) -> jax.Array:
    """Of a black body, from the far ultraviolet to the far infrared."""
    return spectrum.blackbody(kelvin, np.array([100.0, 555.0, 1e5]))


def against_a_white(case: dict[str, Any]) -> jax.Array:
    """The colour of a surface under a light, and of the light."""
    light = case["other"]
    shone = jnp.stack([case["colour"] * light, light])
    return observer.spectrum_to_xyz(shone, WAVELENGTHS, white=light)


def of_one_colour(case: dict[str, Any]) -> jax.Array:
    """A reflectance with the colour of one and nearly the spectrum of another."""
    ends = (jnp.tile(case[name], 2) for name in ("colour", "other"))
    return metamer.metamer(*ends, np.ones(6), np.linspace(450.0, 650.0, 6))


def around_white(f: Callable[..., Any]) -> Callable[..., Any]:
    """Of chromaticities anywhere, at white and next to it."""

    def of(colour: jax.Array) -> Any:
        white = jnp.asarray(cie.D65, colour.dtype)
        return f(
            jnp.stack([colour[:2], white + (colour[:2] - colour[1:]), white + 1e-9 * colour[:2]])
        )

    return of


def between_colours(case: dict[str, Any]) -> Any:
    """The way from one colour to another in every system."""
    ends = case["colour"], case["other"]
    return [interpolate.interpolate(*ends, case["share"], name) for name in interpolate.SYSTEMS]


def powers(deck: Deck) -> Cases:
    """A cosine, and an exponent."""
    return {"x": deck.numbers(most=1.0), "n": strategies.materials(deck)["shininess"]}
