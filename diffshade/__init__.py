"""Differentiable shading: from surfaces, lights and materials to images, in JAX.

Names resolve when they are first used, so that `import diffshade` costs nothing by itself.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from diffshade.errors import BadInput as BadInput
    from diffshade.fusion import compiler_options as compiler_options
    from diffshade.geometry.camera import OrthographicCamera as OrthographicCamera
    from diffshade.geometry.camera import PerspectiveCamera as PerspectiveCamera
    from diffshade.geometry.frequency import FlatShading as FlatShading
    from diffshade.geometry.frequency import GouraudShading as GouraudShading
    from diffshade.geometry.frequency import PhongShading as PhongShading
    from diffshade.geometry.gbuffer import GBuffer as GBuffer
    from diffshade.geometry.gbuffer import gbuffer as gbuffer
    from diffshade.geometry.gbuffer import visibility as visibility
    from diffshade.geometry.mesh import Mesh as Mesh
    from diffshade.geometry.mesh_file import load_mesh as load_mesh
    from diffshade.geometry.sphere import Sphere as Sphere
    from diffshade.light.attenuation import ExponentialAttenuation as ExponentialAttenuation
    from diffshade.light.attenuation import InverseSquare as InverseSquare
    from diffshade.light.attenuation import LinearAttenuation as LinearAttenuation
    from diffshade.light.attenuation import QuadraticAttenuation as QuadraticAttenuation
    from diffshade.light.parallel import ParallelLight as ParallelLight
    from diffshade.light.point import PointLight as PointLight
    from diffshade.reflectance.blinn_phong import BlinnPhong as BlinnPhong
    from diffshade.reflectance.material import Material as Material
    from diffshade.reflectance.phong import Phong as Phong
    from diffshade.scene import Scene as Scene
    from diffshade.shading.basis import Basis as Basis
    from diffshade.shading.basis import basis as basis
    from diffshade.shading.basis import contract as contract
    from diffshade.shading.render import render as render

_HOME = {
    "BadInput": "errors",
    "Basis": "shading.basis",
    "BlinnPhong": "reflectance.blinn_phong",
    "ExponentialAttenuation": "light.attenuation",
    "FlatShading": "geometry.frequency",
    "GBuffer": "geometry.gbuffer",
    "GouraudShading": "geometry.frequency",
    "InverseSquare": "light.attenuation",
    "LinearAttenuation": "light.attenuation",
    "Material": "reflectance.material",
    "Mesh": "geometry.mesh",
    "OrthographicCamera": "geometry.camera",
    "ParallelLight": "light.parallel",
    "PerspectiveCamera": "geometry.camera",
    "Phong": "reflectance.phong",
    "PhongShading": "geometry.frequency",
    "PointLight": "light.point",
    "QuadraticAttenuation": "light.attenuation",
    "Scene": "scene",
    "Sphere": "geometry.sphere",
    "basis": "shading.basis",
    "compiler_options": "fusion",
    "contract": "shading.basis",
    "gbuffer": "geometry.gbuffer",
    "load_mesh": "geometry.mesh_file",
    "render": "shading.render",
    "visibility": "geometry.gbuffer",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'diffshade' has no attribute {name!r}")
    value = getattr(import_module(f"diffshade.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
