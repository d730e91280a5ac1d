"""The illumination model in plain NumPy, float64, written from the texts LIGHT-1 to LIGHT-16.

It shares no code with the package and no trick either: one light after the other, arrays
[..., 3], nothing fused. Scenes are plain dictionaries in the shape of `scene.toml`:

    {"kind": "point", "position": p, "intensity": I, "attenuation": {"c0": 1, "c1": 0, "c2": 0.1}}
    {"kind": "parallel", "direction": towards_the_light, "intensity": I}
    {"kind": "sphere", "center": c, "radius": r}
    {"kind": "mesh", "vertices": [V, 3], "faces": [F, 3], "normals": [V, 3]}
    {"kind": "orthographic", "width": W, "height": H, "extent": e}    # and position, target, up
    {"kind": "perspective", "width": W, "height": H, "fov": f, "position": p, "target": t, "up": u}
    {"ka": ..., "kd": ..., "ks": ..., "shininess": n}                 # what is left out is absent
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray
Plain = Mapping[str, Any]
"""A light, geometry, camera or material as plain numbers."""


class Hits(NamedTuple):
    """What the pixels see: planes over the whole image, NaN where nothing is seen."""

    mask: Array
    """[H, W], which pixels see the surface."""
    position: Array
    """[H, W, 3], the point P."""
    normal: Array
    """[H, W, 3], unit normal u_n at P."""
    view: Array
    """[H, W, 3], unit vector u_o from P to the observer."""


def unit(v: Array) -> Array:
    """v / |v|."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def dot(a: Array, b: Array) -> Array:
    """a.b with the last axis kept, so that it multiplies a vector or a colour."""
    return np.sum(a * b, axis=-1, keepdims=True)


def attenuation(d: Array, constants: Mapping[str, float] | None) -> Array:
    """f_att = min(1 / (c0 + c1 d + c2 d^2), 1), LIGHT-12; 1 without constants."""
    if constants is None:
        return np.ones_like(d)
    c0, c1, c2 = (float(constants.get(name, 0.0)) for name in ("c0", "c1", "c2"))
    return np.minimum(1.0 / (c0 + c1 * d + c2 * d**2), 1.0)


def shade(
    position: Array,
    normal: Array,
    view: Array,
    lights: Iterable[Plain],
    material: Plain,
    *,
    ambient: Any = 0.0,
) -> Array:
    """I = I_a k_a + sum over lights of I_p f_att [k_d u_n.u_s + k_s (u_r.u_o)^n], LIGHT-13.

    The ambient term stands once, both light terms are zero where u_n.u_s <= 0, and the specular
    one also where u_r.u_o <= 0.
    """
    ka, kd, ks = (
        np.broadcast_to(np.asarray(material.get(name, 0.0), np.float64), (3,))
        for name in ("ka", "kd", "ks")
    )
    image = np.broadcast_to(np.asarray(ambient, np.float64) * ka, position.shape).copy()
    for light in lights:
        if light["kind"] == "point":
            s = np.asarray(light["position"], np.float64) - position  # LIGHT-3a
            d = np.linalg.norm(s, axis=-1, keepdims=True)  # LIGHT-3b
            u_s = s / d  # LIGHT-3c
            f = attenuation(d, light.get("attenuation"))
        else:
            u_s = np.broadcast_to(unit(np.asarray(light["direction"], np.float64)), position.shape)
            f = np.ones_like(position[..., :1])
        cos_theta = dot(normal, u_s)
        u_r = 2.0 * cos_theta * normal - u_s  # LIGHT-10
        cos_alpha = dot(u_r, view)  # LIGHT-6
        diffuse = np.maximum(cos_theta, 0.0)  # LIGHT-4
        specular = np.maximum(cos_alpha, 0.0) ** material.get("shininess", 1.0)  # LIGHT-5
        specular = np.where((cos_theta > 0.0) & (cos_alpha > 0.0), specular, 0.0)
        image += np.asarray(light["intensity"], np.float64) * f * (kd * diffuse + ks * specular)
    return image


def rays(camera: Plain) -> tuple[Array, Array]:
    """Origin and unit direction [H, W, 3] of the ray through each pixel's centre.

    Row 0 is the top of the image; the centre of pixel (i, j) is (j + 0.5, i + 0.5).
    """
    width, height = camera["width"], camera["height"]
    position = np.asarray(camera.get("position", (0.0, 0.0, 1e3)), np.float64)
    target = np.asarray(camera.get("target", (0.0, 0.0, 0.0)), np.float64)
    forward = unit(target - position)
    right = unit(np.cross(forward, np.asarray(camera.get("up", (0.0, 1.0, 0.0)), np.float64)))
    up = np.cross(right, forward)
    if camera["kind"] == "orthographic":
        pixel = camera["extent"] / width
    else:
        pixel = 2.0 * np.tan(camera["fov"] / 2.0) / height
    x = (np.arange(width) + 0.5 - width / 2.0) * pixel
    y = (height / 2.0 - np.arange(height) - 0.5) * pixel
    offset = x[None, :, None] * right + y[:, None, None] * up
    if camera["kind"] == "orthographic":
        return position + offset, np.broadcast_to(forward, offset.shape)
    return np.broadcast_to(position, offset.shape), unit(forward + offset)


def see(geometry: Plain, camera: Plain) -> Hits:
    """The nearest point of the surface on each ray, and the normal there."""
    origin, direction = rays(camera)
    position, normal = (_sphere if geometry["kind"] == "sphere" else _mesh)(
        geometry, origin, direction
    )
    return Hits(np.isfinite(position[..., 0]), position, normal, -direction)


def _sphere(geometry: Plain, origin: Array, direction: Array) -> tuple[Array, Array]:
    """LIGHT-14 to LIGHT-16, along any ray."""
    center = np.asarray(geometry["center"], np.float64)
    radius = float(geometry["radius"])
    to_center = center - origin
    along = dot(to_center, direction)
    # The distance of the ray from the centre by its vector: no two large squares are subtracted.
    across = along * direction - to_center
    half_chord_squared = radius**2 - dot(across, across)
    half_chord = np.sqrt(np.where(half_chord_squared > 0.0, half_chord_squared, np.nan))
    normal = (across - half_chord * direction) / radius
    return center + radius * normal, normal


def _mesh(geometry: Plain, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Every triangle against every ray; normals interpolated from the vertices, renormalised."""
    vertices, normals = (np.asarray(geometry[k], np.float64) for k in ("vertices", "normals"))
    nearest = np.full((*origin.shape[:-1], 1), np.inf)
    position, normal = np.full(origin.shape, np.nan), np.full(origin.shape, np.nan)
    for face in np.asarray(geometry["faces"]):
        p0, p1, p2 = vertices[face]
        # origin + t direction = p0 + u (p1 - p0) + v (p2 - p0), by Cramer's rule.
        e1, e2, s = p1 - p0, p2 - p0, origin - p0
        q, w = np.cross(direction, e2), np.cross(s, e1)
        det = dot(q, np.broadcast_to(e1, q.shape))
        det = np.where(np.abs(det) > 1e-14, det, np.nan)
        u, v, t = (
            dot(q, s) / det,
            dot(w, direction) / det,
            dot(w, np.broadcast_to(e2, w.shape)) / det,
        )
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0) & (t < nearest)
        nearest = np.where(hit, t, nearest)
        position = np.where(hit, origin + t * direction, position)
        n0, n1, n2 = normals[face]
        normal = np.where(hit, unit((1.0 - u - v) * n0 + u * n1 + v * n2), normal)
    return position, normal


def render(
    objects: Sequence[tuple[Plain, Plain]],
    lights: Sequence[Plain],
    camera: Plain,
    *,
    ambient: Any = 0.0,
) -> Array:
    """The image [H, W, 3] of (geometry, material) pairs: linear, no shadows, background 0."""
    image = np.zeros((camera["height"], camera["width"], 3))
    nearest = np.full(image.shape[:2], np.inf)
    origin, _ = rays(camera)
    for geometry, material in objects:
        hits = see(geometry, camera)
        distance = np.linalg.norm(hits.position - origin, axis=-1)
        front = hits.mask & (distance < nearest)
        nearest = np.where(front, distance, nearest)
        p, n, v = hits.position[front], hits.normal[front], hits.view[front]
        image[front] = shade(p, n, v, lights, material, ambient=ambient)
    return image
