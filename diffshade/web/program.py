"""The fragment shader of a scene: the illumination equation in GLSL, of the parts that the scene has.

Each part is a snippet in `glsl/`, which mirrors the module of the same formula; `#include` names what it
needs, and each is taken once. What a scene lacks is in no line of the program.
"""

from __future__ import annotations

import posixpath
from importlib.resources import files
from typing import Any

from diffshade.errors import BadInput
from diffshade.geometry.camera import OrthographicCamera, PerspectiveCamera
from diffshade.geometry.frequency import FlatShading, GouraudShading, PhongShading
from diffshade.geometry.mesh import Mesh
from diffshade.light.attenuation import (
    ExponentialAttenuation,
    InverseSquare,
    LinearAttenuation,
    QuadraticAttenuation,
    Windowed,
)
from diffshade.light.parallel import ParallelLight
from diffshade.light.spot import SpotLight
from diffshade.reflectance.blinn_phong import BlinnPhong
from diffshade.reflectance.fresnel import Conductor, Dielectric, Schlick
from diffshade.reflectance.microfacet import GGX, AbstractMicrofacet, Beckmann, TorranceSparrow
from diffshade.reflectance.phong import Phong
from diffshade.web.shown import Shown, is_lit

__all__ = ["Program", "program", "uniform"]

UNIFORMS = 200
"""What every WebGL 2 has room for, some left for the camera: 224 vectors (OpenGL ES 3.0, 7.12)."""

CAMERAS = {OrthographicCamera: "orthographic", PerspectiveCamera: "perspective"}
FREQUENCIES = {
    PhongShading: "phong_shading",
    FlatShading: "flat_shading",
    GouraudShading: "gouraud_shading",
}
ATTENUATIONS: dict[Any, tuple[str, tuple[str, ...]]] = {
    QuadraticAttenuation: ("quadratic", ("c0", "c1", "c2")),
    LinearAttenuation: ("linear", ("c0", "c1")),
    InverseSquare: ("inverse_square", ()),
    ExponentialAttenuation: ("exponential", ("a",)),
}
POWERS: dict[Any, str] = {Phong: "phong", BlinnPhong: "blinn_phong"}
FACETS: dict[Any, str] = {
    GGX: "ggx",
    Beckmann: "beckmann",
    TorranceSparrow: "torrance_sparrow",
}
BOUNDARIES: dict[Any, tuple[str, tuple[str, ...]]] = {
    Dielectric: ("dielectric", ("index",)),
    Conductor: ("conductor", ("index", "extinction")),
    Schlick: ("schlick", ("f0",)),
}


class Program:
    """A shader that grows by the parts that are asked for, and the coefficients that it then has.

    `kinds` says of each, by its name in the scene, what it is: "channels" (one number, or one a
    channel), "number", "position" or "direction".
    """

    def __init__(self) -> None:
        self.snippets: dict[str, str] = {}
        self.kinds: dict[str, str] = {}

    def include(self, name: str) -> None:
        """Take a snippet of `glsl/`, such as "reflectance/phong", after those that it names."""
        if name in self.snippets:
            return
        source = files("diffshade.web").joinpath("glsl", f"{name}.glsl").read_text(encoding="utf-8")
        own = []
        for line in source.splitlines():
            if line.startswith("#include"):
                wanted = line.split('"')[1].removesuffix(".glsl")
                self.include(posixpath.normpath(posixpath.join(posixpath.dirname(name), wanted)))
            else:
                own.append(line)
        self.snippets[name] = "\n".join(own).strip()

    def value(self, name: str, kind: str = "channels") -> str:
        """A coefficient in GLSL, by its name."""
        self.kinds[name] = kind
        return uniform(name)

    def declarations(self) -> str:
        """The uniforms, which the page's controls set."""
        types = {name: "float" if kind == "number" else "vec3" for name, kind in self.kinds.items()}
        return "\n".join(f"uniform {types[name]} {uniform(name)};" for name in self.kinds)


def uniform(name: str) -> str:
    """The name of a coefficient's uniform.

    >>> uniform("specular.0.ks")
    'specular_0_ks'
    """
    return name.replace(".", "_")


def program(shown: Shown) -> tuple[str, dict[str, str]]:
    """The source of the fragment shader, and the `kinds` of what it is told by sliders.

    Raises `BadInput` for parts that there is no snippet of, and for more of them than WebGL has room
    for.
    """
    made = Program()
    radiance = _radiance(made, shown)
    shading = _part(FREQUENCIES, shown.shading or PhongShading(), "shading")
    surface = shading if isinstance(shown.geometry, Mesh) else "sphere"
    if len(made.kinds) > UNIFORMS:
        raise BadInput(
            f"the scene has {len(made.kinds)} coefficients, and WebGL room for {UNIFORMS}: leave out"
            " lights or lobes"
        )
    made.include(f"geometry/{_part(CAMERAS, shown.camera, 'camera')}")
    formulas = dict(made.snippets)
    made.include(f"geometry/{surface}")
    made.include("colour/srgb")
    last = [text for name, text in made.snippets.items() if name not in formulas]
    parts = [_HEAD, made.declarations(), *formulas.values(), radiance, *last, _MAIN]
    return "\n\n".join(filter(None, parts)) + "\n", made.kinds


_HEAD = """#version 300 es
precision highp float;
precision highp int;

out vec4 colour;
uniform highp isampler2D seen;  // of each pixel the face that it sees; -1 is none
uniform float side;  // of the image, in pixels, that the field of view is measured along"""

_MAIN = """void main() {
  ivec2 size = textureSize(seen, 0);
  int face = texelFetch(seen, ivec2(int(gl_FragCoord.x), size.y - 1 - int(gl_FragCoord.y)), 0).r;
  colour = vec4(0.0, 0.0, 0.0, 1.0);
  if (face < 0) return;
  vec3 o, d;
  ray((gl_FragCoord.xy - 0.5 * vec2(size)) / side, o, d);
  colour.rgb = display(shaded(face, o, d));
}"""


def _part(known: dict[Any, Any], part: Any, what: str) -> Any:
    found = known.get(type(part))
    if found is None:
        kinds = ", ".join(kind.__name__ for kind in known)
        raise BadInput(f"the page knows no {what} {type(part).__name__}: give one of {kinds}")
    return found


def _radiance(made: Program, shown: Shown) -> str:
    """I = I_a k_a O_d + sum over lights I_p f [k_d O_d n.l + k_s O_s s(n, l, v)] (LIGHT-13)."""
    scene, material = shown.scene, shown.material
    viewed = material.is_seen_from and is_lit(scene, material)
    terms = []
    if scene.ambient is not None and material.ka is not None:
        terms.append(_product(made.value("ambient"), made.value("ka"), *_colour(made, shown, "od")))
    lines = []
    reflected = ""
    if is_lit(scene, material):
        reflected = _reflected(made, shown) + "\n\n"
        for number, light in enumerate(scene.lights):
            lines += _light(made, light, f"lights.{number}", viewed)
    view = ["vec3 v = towards_viewer(p);"] if viewed else []
    body = [*view, f"vec3 sum = {' '.join(terms) or 'vec3(0.0)'};", *lines, "return sum;"]
    return reflected + _function("vec3 radiance(vec3 p, vec3 n)", body)


def _reflected(made: Program, shown: Shown) -> str:
    """k_d O_d n.l + k_s O_s s(n, l, v)."""
    material = shown.material
    made.include("reflectance/lambert")
    lines = ["float n_dot_l = dot(n, l);"]
    terms = []
    if material.kd is not None:
        factors = [made.value("kd"), *_colour(made, shown, "od"), "lambert(n_dot_l)"]
        if material.body is not None:
            made.include("reflectance/body")
            index = made.value("body.index")
            factors.append(f"passed(lambert(n_dot_l), lambert(dot(n, v)), {index})")
        terms.append(_product(*factors))
    if any(isinstance(lobe, AbstractMicrofacet) for lobe in material.specular):
        made.include("reflectance/facets")
        lines.append("Facets seen = facets_between(n, l, v, n_dot_l);")
    for number, lobe in enumerate(material.specular):
        path = f"specular.{number}"
        factors = [made.value(f"{path}.ks"), *_colour(made, shown, "os")]
        terms.append(_product(*factors, *_shape(made, lobe, path)))
    lines.append(f"return {' + '.join(terms)};")
    view = ", vec3 v" if material.is_seen_from else ""
    return _function(f"vec3 reflected(vec3 n, vec3 l{view})", lines)


def _colour(made: Program, shown: Shown, name: str) -> list[str]:
    return [] if getattr(shown.material, name) is None else [made.value(name)]


def _shape(made: Program, lobe: Any, path: str) -> list[str]:
    """The factors of s(n, l, v)."""
    if type(lobe) in POWERS:
        kind = POWERS[type(lobe)]
        made.include(f"reflectance/{kind}")
        shape = [f"{kind}(n, l, v, n_dot_l, {made.value(f'{path}.shininess')})"]
        return shape + _boundary(made, lobe.weight, f"{path}.weight", "lambert(n_dot_l)")
    kind = _part(POWERS | FACETS, lobe, "lobe")
    made.include(f"reflectance/{kind}")
    alpha = made.value(f"{path}.alpha")
    hidden = _masking(made, lobe, alpha)
    shape = [f"{kind}(seen, {alpha})", hidden]
    return shape + _boundary(made, lobe.fresnel, f"{path}.fresnel", "seen.h_dot_l")


def _masking(made: Program, lobe: Any, alpha: str) -> str:
    """G / (4 n.v)."""
    kind = lobe.masking.replace("-", "_")
    made.include(f"reflectance/{kind}")
    if kind == "v_groove":
        return "v_groove(seen)"
    shadow = "ggx_shadow"
    if isinstance(lobe, Beckmann):
        shadow = "rational_beckmann_shadow" if lobe.rational else "beckmann_shadow"
        made.include(f"reflectance/{shadow}")
    of_l, of_v = (f"{shadow}(seen.n_dot_{x}, {alpha})" for x in "lv")
    return f"{kind}(seen, {of_l}, {of_v})"


def _boundary(made: Program, boundary: Any, path: str, cosine: str) -> list[str]:
    """F; nothing where there is no boundary."""
    if boundary is None:
        return []
    kind, constants = _part(BOUNDARIES, boundary, "boundary")
    made.include(f"reflectance/{kind}")
    given = (made.value(f"{path}.{name}") for name in constants)
    return [f"{kind}({', '.join((cosine, *given))})"]


def _light(made: Program, light: Any, path: str, viewed: bool) -> list[str]:
    """The lines that add one light."""
    view = ", v" if viewed else ""
    intensity = made.value(f"{path}.intensity")
    if isinstance(light, ParallelLight):
        towards = made.value(f"{path}.direction", "direction")
        return [f"sum += {_product(intensity, f'reflected(n, {towards}{view})')};"]
    made.include("vector")
    number = path.split(".")[1]
    s, l = f"s{number}", f"l{number}"
    lines = [
        f"vec3 {s} = {made.value(f'{path}.position', 'position')} - p;",
        f"vec3 {l} = direction({s});",
    ]
    factors = [intensity]
    if isinstance(light, SpotLight):
        cosine = f"-dot({l}, {made.value(f'{path}.direction', 'direction')})"
        made.include("light/spot")
        factors.append(f"shining({cosine}, {made.value(f'{path}.exponent', 'number')})")
        if light.cutoff is not None:
            made.include("light/cutoff")
            factors.append(f"inside({cosine}, {made.value(f'{path}.cutoff', 'number')})")
    if light.attenuation is not None:
        factors += _attenuation(made, light.attenuation, f"{path}.attenuation", f"length({s})")
    return [*lines, f"sum += {_product(*factors, f'reflected(n, {l}{view})')};"]


def _attenuation(made: Program, law: Any, path: str, d: str) -> list[str]:
    """f(d), and the window."""
    window = []
    if isinstance(law, Windowed):
        made.include("light/window")
        window = [f"window({d}, {made.value(f'{path}.reach', 'number')})"]
        law, path = law.law, f"{path}.law"
    kind, constants = _part(ATTENUATIONS, law, "attenuation")
    made.include(f"light/{kind}")
    given = (made.value(f"{path}.{name}", "number") for name in constants)
    return [f"{kind}({', '.join((d, *given))})", *window]


def _product(*factors: str) -> str:
    return " * ".join(factors)


def _function(head: str, lines: list[str]) -> str:
    return "\n".join([f"{head} {{", *(f"  {line}" for line in lines), "}"])
