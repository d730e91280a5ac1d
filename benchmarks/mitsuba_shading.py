"""The rival in Mitsuba 3: the same shading through its own objects, compiled by LLVM.

Material and lights are plugins in Python, as Mitsuba's own know neither LIGHT-13's lobe nor its
attenuation: a BSDF and an emitter. At surface interactions made of the given planes, so that no ray is
cast, Python loops over the scene's emitters, which unrolls them; a symbolic loop that calls them by
pointer takes up to twice as long. Parameters are opaque and what Python traces is frozen, as in
`drjit_shading.py`.
"""

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from benchmarks.rivals import threads

mi.set_variant("llvm_ad_rgb")

__all__ = ["forward", "gradient"]

TINY = 1e-30
"""Below it, r.v counts as zero: a logarithm is taken of it."""


class Phong(mi.BSDF):
    """kd n.l + ks max(0, r.v)^n; the attribute `ka` reflects ambient light."""

    def __init__(self, props: mi.Properties) -> None:
        super().__init__(props)
        self.m_flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
        self.m_components = [self.m_flags]
        self.ka, self.kd, self.ks = (mi.Color3f(props[name]) for name in ("ka", "kd", "ks"))
        self.shininess = mi.Float(props["shininess"])
        dr.make_opaque(self.ka, self.kd, self.ks, self.shininess)

    def traverse(self, callback: mi.TraversalCallback) -> None:
        for name in ("ka", "kd", "ks", "shininess"):
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def eval(
        self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: Any = True
    ) -> mi.Color3f:
        n_dot_l, r_dot_v = mi.Frame3f.cos_theta(wo), dr.dot(mi.reflect(wo), si.wi)
        bright = active & (n_dot_l > 0) & (r_dot_v > TINY)
        power = dr.exp2(self.shininess * dr.log2(dr.select(bright, r_dot_v, 1)))
        lit = dr.select(active, dr.maximum(n_dot_l, 0), 0)
        return self.kd * lit + self.ks * dr.select(bright, power, 0)

    def eval_attribute_3(
        self, name: str, si: mi.SurfaceInteraction3f, active: Any = True
    ) -> mi.Color3f:
        return dr.select(active, getattr(self, name), 0)


class AttenuatedPoint(mi.Emitter):
    """A point light that falls off as min(1 / (c0 + c1 d + c2 d^2), 1), or, not attenuated, never."""

    def __init__(self, props: mi.Properties) -> None:
        super().__init__(props)
        self.m_flags = +mi.EmitterFlags.DeltaPosition
        self.position = mi.Point3f(props["position"])
        self.intensity = mi.Color3f(props["intensity"])
        self.attenuated = props["attenuated"]
        self.c0, self.c1, self.c2 = (mi.Float(props[name]) for name in ("c0", "c1", "c2"))
        dr.make_opaque(self.position, self.intensity, self.c0, self.c1, self.c2)

    def traverse(self, callback: mi.TraversalCallback) -> None:
        for name in ("position", "intensity", "c0", "c1", "c2"):
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def sample_direction(
        self, it: mi.Interaction3f, sample: mi.Point2f, active: Any = True
    ) -> tuple[mi.DirectionSample3f, mi.Color3f]:
        towards = dr.zeros(mi.DirectionSample3f)
        towards.p, towards.pdf, towards.delta = self.position, 1, True
        s = self.position - it.p
        square = dr.squared_norm(s)
        reciprocal = dr.rsqrt(square)
        towards.d, towards.dist = s * reciprocal, square * reciprocal
        arriving = self.intensity
        if self.attenuated:
            q = self.c0 + self.c1 * towards.dist + self.c2 * square
            arriving = dr.minimum(dr.rcp(q), 1) * arriving
        return towards, dr.select(active, arriving, 0)


mi.register_bsdf("light13", Phong)
mi.register_emitter("attenuated_point", AttenuatedPoint)


def _shade(
    scene: mi.Scene, points: mi.Point3f, normals: mi.Normal3f, eye: mi.Point3f, ambient: mi.Float
) -> mi.Color3f:
    """The image's three planes."""
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(points))
    si.p, si.n, si.sh_frame = points, normals, mi.Frame3f(normals)
    v = eye - points
    si.wi = si.to_local(v * dr.rsqrt(dr.squared_norm(v)))
    bsdf, context = scene.shapes()[0].bsdf(), mi.BSDFContext()
    image = ambient * bsdf.eval_attribute_3("ka", si)
    for emitter in scene.emitters():
        towards, arriving = emitter.sample_direction(si, mi.Point2f(0))
        image += arriving * bsdf.eval(context, si, si.to_local(towards.d))
    return image


def _step(scene: mi.Scene, given: tuple[Any, ...], wanted: mi.Color3f) -> list[mi.Float]:
    """The sums of the squares and of their 13 derivatives."""
    # Derivatives in planes of zeros, as in `drjit_shading.py`. The plugins derive nothing from their
    # parameters, so that there is nothing to update; `update` would write the planes to memory.
    unknown = [dr.zeros(mi.Float, dr.width(wanted)) for _ in range(13)]
    dr.enable_grad(unknown)
    colours = (mi.Color3f(*unknown[k : k + 3]) for k in (0, 3, 6))
    names = ("ka", "kd", "ks", "shininess", "c0", "c1", "c2")
    zeros = dict(zip(names, (*colours, *unknown[9:]), strict=True))
    parameters = mi.traverse(scene)
    kept = {key: type(value)(value) for key, value in parameters if key.rpartition(".")[2] in zeros}
    for key, value in kept.items():
        parameters[key] = value + zeros[key.rpartition(".")[2]]
    squares = dr.squared_norm(_shade(scene, *given) - wanted)
    dr.backward(squares)
    for key, value in kept.items():
        parameters[key] = value
    planes = [dr.detach(squares), *(dr.grad(x) for x in unknown)]
    return [dr.sum(plane, mode="symbolic") for plane in planes]


def _arguments(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> tuple[Any, ...]:
    """Those of `_shade`."""
    dr.set_thread_count(threads())
    lobe = {name: mi.ScalarColor3f(*scene[name]) for name in ("ka", "kd", "ks")}
    material = {"type": "light13", **lobe, "shininess": scene["shininess"]}
    constants = (1.0, 0.0, 0.0) if scene["constants"] is None else scene["constants"]
    law = dict(zip(("c0", "c1", "c2"), constants, strict=True))
    law["attenuated"] = scene["constants"] is not None
    lights = {
        f"light_{j}": {
            "type": "attenuated_point",
            "position": mi.ScalarPoint3f(*position),
            "intensity": mi.ScalarColor3f(*np.broadcast_to(intensity, 3)),
            **law,
        }
        for j, (position, intensity) in enumerate(
            zip(scene["positions"], scene["intensities"], strict=True)
        )
    }
    given = (
        mi.Point3f(*_planes(points)),
        mi.Normal3f(*_planes(normals)),
        mi.Point3f(*map(float, eye)),
        mi.Float(scene["ambient"]),
    )
    dr.make_opaque(given)
    # A scene needs a shape to hold the material.
    ball = {"type": "sphere", "bsdf": material}
    return mi.load_dict({"type": "scene", "ball": ball, **lights}), *given


def _planes(values: np.ndarray) -> list[mi.Float]:
    return [mi.Float(np.array(plane, np.float32)) for plane in values]


def forward(
    points: np.ndarray, normals: np.ndarray, eye: np.ndarray, scene: dict[str, Any]
) -> Callable[[], mi.Color3f]:
    """A call shades once and returns the image's planes."""
    arguments = _arguments(points, normals, eye, scene)
    shade = dr.freeze(_shade)

    def run() -> mi.Color3f:
        image = shade(*arguments)
        dr.eval(image)
        dr.sync_thread()
        return image

    return run


def gradient(
    points: np.ndarray,
    normals: np.ndarray,
    eye: np.ndarray,
    scene: dict[str, Any],
    target: np.ndarray,
) -> Callable[[], tuple[float, np.ndarray]]:
    """A call returns the loss and its gradient [13] in ka, kd, ks, n, c0, c1 and c2."""
    made, *given = _arguments(points, normals, eye, scene)
    wanted = mi.Color3f(*_planes(target))
    dr.eval(wanted)
    step = dr.freeze(_step)

    def run() -> tuple[float, np.ndarray]:
        sums = step(made, given, wanted)
        dr.eval(sums)
        dr.sync_thread()
        loss, *slope = (float(x[0]) / target.size for x in sums)
        return loss, np.array(slope)

    return run
