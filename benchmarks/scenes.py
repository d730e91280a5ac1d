"""What is measured: a ball under point lights with attenuation, as plain numbers."""

from typing import Any, NamedTuple

import numpy as np

__all__ = ["EYE", "Case", "numbers", "ours", "perspective"]

EYE = (0.0, 0.0, 6.0)
FOV = 0.375
"""In radians: the ball's outline, at 0.335, fills the image as in an orthographic one of extent 2.2."""


class Case(NamedTuple):
    """A sphere of `size` x `size` pixels under `lights` lights, coloured or of one colour."""

    size: int = 512
    lights: int = 4
    coloured: bool = True
    attenuated: bool = True


def numbers(case: Case) -> dict[str, Any]:
    """The scene as plain numbers, the same for every implementation."""
    rng = np.random.default_rng(0)
    count = case.lights
    direction = np.column_stack([rng.uniform(-1.5, 1.5, (count, 2)), rng.uniform(1.5, 3, count)])
    intensity = rng.uniform(0.4, 1.2, (count, 3)) / count * 2
    return {
        "positions": direction,
        "intensities": intensity if case.coloured else intensity[:, 0],
        "constants": (1.0, 0.05, 0.02) if case.attenuated else None,
        "ka": (0.1, 0.08, 0.06),
        "kd": (0.6, 0.4, 0.2),
        "ks": (0.4, 0.4, 0.5),
        "shininess": 32.0,
        "ambient": 0.3,
        "extent": 2.2,
    }


def perspective(case: Case) -> Any:
    """A camera at `EYE` that sees the ball as large as the orthographic one does."""
    import diffshade as ds

    return ds.PerspectiveCamera(
        case.size, case.size, fov=FOV, position=EYE, target=(0, 0, 0), up=(0, 1, 0)
    )


def ours(case: Case, camera: Any = None) -> tuple[Any, Any, Any]:
    """G-buffer, scene and material, by the public interface alone, so that old versions run it."""
    import diffshade as ds

    plain = numbers(case)
    if camera is None:
        camera = ds.OrthographicCamera(width=case.size, height=case.size, extent=plain["extent"])
    constants = plain["constants"]
    lights = tuple(
        ds.PointLight(
            position=position,
            intensity=intensity,
            attenuation=None if constants is None else ds.QuadraticAttenuation(*constants),
        )
        for position, intensity in zip(
            plain["positions"].tolist(), plain["intensities"].tolist(), strict=True
        )
    )
    lobe = ds.Phong(ks=plain["ks"], shininess=plain["shininess"])
    material = ds.Material(ka=plain["ka"], kd=plain["kd"], specular=lobe)
    gbuffer = ds.gbuffer(ds.Sphere(), camera)
    return gbuffer, ds.Scene(ambient=plain["ambient"], lights=lights), material
