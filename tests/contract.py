"""The contract of every public function: finite values and derivatives for input of `guard`'s ranges.

`CONTRACT` says of each how a case is made (`strategies`) and what is computed of it; `NO_FLOATS` which
names have nothing to differentiate, and why. What is exported and stands in neither fails a test.
"""

from collections.abc import Callable, Iterator
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import strategies
from jax.flatten_util import ravel_pytree
from strategies import Cases, Deck

import diffshade as ds
from diffshade import guard, vector
from diffshade.colour import cie, device, interpolate, srgb, transfer
from diffshade.fusion import search_options
from diffshade.geometry import normals
from diffshade.geometry.surface import Visibility
from diffshade.reflectance import blinn_phong, lambert, phong
from diffshade.vector import Vec3

__all__ = ["CONTRACT", "NO_FLOATS", "Contract", "exported", "failure", "finite"]

MODES = ("value", "grad", "jacfwd", "jacrev", "hessian")

NO_FLOATS = {
    "interpolate.SYSTEMS": "names, and functions of `colour.device`",
    "cie.D65": "two numbers",
    "cie.SRGB": "numbers",
    "cie.Primaries": "numbers of the host",
    "cie.in_gamut": "says yes or no",
    "transfer.intensity_levels": "computed on the host",
    "transfer.levels_needed": "computed on the host",
    "transfer.look_up_table": "computed on the host",
    "guard.shortest": "a constant of a type",
    "BadInput": "an exception",
    "compiler_options": "options of a compiler",
    "load_mesh": "reads a file; what it gives is a Mesh",
    "visibility": "decides on values, and is never differentiated",
}


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


def exported() -> Iterator[str]:
    """The public names: of the package, and of the modules that formulas are read in."""
    modules: tuple[ModuleType, ...] = (
        *(ds, guard, vector, normals, lambert, phong, blinn_phong),
        *(cie, device, interpolate, srgb, transfer),
    )
    for module in modules:
        for name in module.__all__:
            within = module.__name__.rpartition(".")[2]
            yield name if hasattr(ds, name) else f"{within}.{name}"


def finite(contract: Contract) -> Callable[[Cases], jax.Array]:
    """One program that says of each case which of the `MODES` are finite: [count, 5]."""

    def of_one(case: dict[str, jax.Array]) -> jax.Array:
        flat, unravel = ravel_pytree(case)

        def values(x: jax.Array) -> jax.Array:
            return jnp.concatenate([jnp.ravel(y) for y in jax.tree.leaves(contract.of(unravel(x)))])

        def total(x: jax.Array) -> jax.Array:
            return values(x).sum()

        slope = jax.grad(total)
        found = (
            values(flat),
            slope(flat),
            jax.jacfwd(values)(flat),
            jax.jacrev(values)(flat),
            jax.jacfwd(slope)(flat),
        )
        return jnp.stack([jnp.isfinite(x).all() for x in found])

    return jax.jit(jax.vmap(of_one), compiler_options=search_options())


def failure(cases: Cases, are_finite: np.ndarray) -> str | None:
    """Of what `finite` says, [count, 5]: the first case that is not, and in which of the `MODES`."""
    bad = np.flatnonzero(~are_finite.all(axis=1))
    if not bad.size:
        return None
    which = [mode for mode, fine in zip(MODES, are_finite[bad[0]], strict=True) if not fine]
    case = {name: array[bad[0]].tolist() for name, array in cases.items()}
    return f"{', '.join(which)} not finite at {case}"


# What is computed of a case


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


def material(case: dict[str, Any], *lobes: type[Any]) -> ds.Material:
    """Everything that a material can have."""
    specular = tuple(lobe(case["ks"], case["shininess"]) for lobe in lobes)
    return ds.Material(case["ka"], case["kd"], specular, case["od"], case["os"])


def shaded(light: Callable[..., Any], *lobes: type[Any], eye: bool = True) -> Contract:
    """The radiance of a point under a light."""

    def of(case: dict[str, Any]) -> Any:
        scene = ds.Scene(case["ambient"], light(case))
        return ds.render(gbuffer(case, eye), scene, material(case, *lobes))

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


def of_colours(f: Callable[..., Any]) -> Contract:
    """A function of a colour."""
    return Contract(strategies.colours, lambda case: f(case["colour"]))


def of_shares(case: dict[str, Any]) -> jax.Array:
    """Of the components in their sum."""
    return guard.ratio(case["colour"], case["colour"].sum(keepdims=True))


def between_colours(case: dict[str, Any]) -> Any:
    """The way from one colour to another in every system."""
    ends = case["colour"], case["other"]
    return [interpolate.interpolate(*ends, case["share"], name) for name in interpolate.SYSTEMS]


def powers(deck: Deck) -> Cases:
    """A cosine, and an exponent."""
    return {"x": deck.numbers(most=1.0), "n": strategies.materials(deck)["shininess"]}


quadratic = partial(point_light, kind=ds.QuadraticAttenuation)

CONTRACT: dict[tuple[str, ...], Contract] = {
    # diffshade
    ("render",): shaded(quadratic, ds.Phong, ds.BlinnPhong),
    ("PointLight",): shaded(point_light, ds.Phong, eye=False),
    ("ParallelLight",): shaded(parallel_light, ds.Phong),
    ("Phong",): shaded(quadratic, ds.Phong),
    ("BlinnPhong",): shaded(quadratic, ds.BlinnPhong),
    ("Material",): shaded(parallel_light, ds.Phong, ds.BlinnPhong, eye=False),
    ("Scene",): shaded(lambda case: (point_light(case), parallel_light(case))),
    ("QuadraticAttenuation",): attenuated(ds.QuadraticAttenuation),
    ("LinearAttenuation",): attenuated(ds.LinearAttenuation),
    ("InverseSquare",): attenuated(ds.InverseSquare),
    ("ExponentialAttenuation",): attenuated(ds.ExponentialAttenuation),
    ("Windowed",): attenuated(ds.Windowed),
    ("KeptGeometry", "keep_geometry"): Contract(strategies.scenes, kept),
    ("Basis", "basis", "contract"): Contract(strategies.scenes, from_basis),
    ("mean_squared_error",): Contract(strategies.captures, error),
    ("Sharded", "shard"): Contract(strategies.scenes, on_a_device),
    ("GBuffer",): Contract(strategies.points, gbuffer),
    ("gbuffer", "Sphere", "OrthographicCamera"): Contract(
        strategies.spheres, partial(ball, orthographic)
    ),
    ("PerspectiveCamera",): Contract(strategies.spheres, partial(ball, perspective)),
    ("Mesh",): Contract(strategies.meshes, partial(triangles, ds.PhongShading(), True)),
    **{
        (type(frequency).__name__,): Contract(
            strategies.meshes, partial(triangles, frequency, False)
        )
        for frequency in (ds.PhongShading(), ds.GouraudShading(), ds.FlatShading())
    },
    # Singularities
    ("guard.log_base", "guard.power", "guard.power_of_log"): Contract(
        powers, lambda case: guard.power(case["x"], case["n"])
    ),
    ("guard.log_one_minus",): Contract(
        powers, lambda case: guard.power_of_log(guard.log_one_minus(abs(case["x"])), case["n"])
    ),
    ("guard.ratio",): Contract(strategies.colours, of_shares),
    ("guard.positive", "lambert.lambert"): of_numbers(lambert.lambert),
    ("guard.reciprocal",): of_inverses(guard.reciprocal),
    ("guard.reciprocal_sqrt",): of_numbers(guard.reciprocal_sqrt),
    ("guard.sqrt",): of_numbers(guard.sqrt),
    # Vectors
    ("vector.Vec3",): of_vectors(lambda a, b: (a + b, a - b, -a, a * b.x, a.to_array())),
    ("vector.cross",): of_vectors(vector.cross),
    ("vector.direction",): of_vectors(vector.direction, 1),
    ("vector.dot",): of_vectors(vector.dot),
    ("vector.halfway",): of_vectors(lambda a, b: vector.halfway(vector.unit(a), vector.unit(b))),
    ("vector.length",): of_vectors(vector.length, 1),
    ("vector.reflect",): of_vectors(vector.reflect),
    ("vector.versine",): of_vectors(vector.versine),
    ("vector.unit",): of_vectors(vector.unit, 1),
    # Normals
    ("normals.face_normals",): of_corners(normals.face_normals),
    ("normals.plane_normals",): of_corners(normals.plane_normals),
    ("normals.newell_normal",): Contract(
        strategies.meshes, lambda case: normals.newell_normal(case["vertices"])
    ),
    ("normals.vertex_normals",): Contract(strategies.meshes, of_vertices),
    ("normals.angle_weights",): of_corners(normals.angle_weights),
    ("normals.area_weights",): of_corners(normals.area_weights),
    ("normals.sphere_weights",): of_corners(normals.sphere_weights),
    ("normals.uniform_weights",): of_corners(normals.uniform_weights),
    # Colours
    **{
        (f"device.{name}",): of_colours(getattr(device, name))
        for name in device.__all__
        if name != "cmyk_to_rgb"
    },
    ("device.cmyk_to_rgb",): of_colours(lambda rgb: device.cmyk_to_rgb(device.rgb_to_cmyk(rgb))),
    ("cie.rgb_to_xyz", "cie.xyz_to_rgb"): of_colours(lambda x: cie.xyz_to_rgb(cie.rgb_to_xyz(x))),
    ("cie.between_screens",): of_colours(lambda x: cie.between_screens(x, cie.SRGB, cie.SRGB)),
    ("cie.xyz_to_xyy",): of_colours(cie.xyz_to_xyy),
    ("cie.xyy_to_xyz",): of_colours(lambda x: cie.xyy_to_xyz(cie.xyz_to_xyy(x))),
    ("cie.xyz_to_luv",): of_colours(cie.xyz_to_luv),
    ("cie.luv_to_xyz",): of_colours(lambda x: cie.luv_to_xyz(cie.xyz_to_luv(x))),
    ("srgb.from_srgb",): of_colours(srgb.from_srgb),
    ("srgb.to_srgb",): of_colours(srgb.to_srgb),
    ("transfer.displayed",): of_colours(lambda x: transfer.displayed(x, 2.2)),
    ("transfer.value_for",): of_colours(lambda x: transfer.value_for(x, 2.2)),
    ("interpolate.interpolate",): Contract(strategies.colours, between_colours),
    # Lobes
    ("phong.phong",): lobe(phong.phong),
    ("blinn_phong.blinn_phong",): lobe(blinn_phong.blinn_phong),
}
