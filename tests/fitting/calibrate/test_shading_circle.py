"""A circle refined by its shading, on renders of a known one; the real ball is in the module's words."""

import numpy as np
import pytest
from povray import render as povray_render
from povray import requires_povray

import diffshade as ds
from diffshade.io.circle import Circle, ball_gbuffer
from fitting.calibrate import refine_circle

TRUE, START = Circle(30.23, 29.61, 25.37), Circle(30.0, 30.0, 25.9)
DIRECTIONS = ((0.4, 0.5, 1), (-0.6, 0.1, 1), (0.1, -0.7, 1), (0, 0.1, 1.0))
SCENES = [ds.Scene(ambient=1.0, lights=ds.ParallelLight(d)) for d in DIRECTIONS]
GLOSSY = ds.Material(ka=0.05, kd=(0.5, 0.3, 0.2), specular=ds.Phong(0.3, 40.0))


@pytest.mark.slow
def test_the_circle_of_a_render_comes_back_within_its_errors(rng: np.random.Generator) -> None:
    images = [np.asarray(ds.render(ball_gbuffer(TRUE, (60, 60)), s, GLOSSY)) for s in SCENES]
    noisy = [i + rng.normal(0, 0.005, i.shape).astype(i.dtype) for i in images]
    found = refine_circle(noisy, START, SCENES)
    error = np.subtract(found.circle, TRUE)
    assert found.converged
    assert not found.at_limit
    assert found.relative_residual < 0.7 * found.before
    assert np.abs(error).max() < 0.05, found
    assert (np.abs(error) < 5 * np.array(found.standard_errors)).all(), found


@pytest.mark.slow
@requires_povray
def test_the_circle_of_a_ball_by_pov_ray() -> None:
    """In the same pixels, by a renderer that knows nothing of the library."""
    center = [TRUE.cx - 30, 30 - TRUE.cy, 0.0]
    sphere = {"kind": "sphere", "center": center, "radius": TRUE.radius}
    material = {"ka": 0.05, "kd": (0.5, 0.3, 0.2), "ks": 0.3, "shininess": 40.0}
    camera = {"kind": "orthographic", "width": 60, "height": 60, "extent": 60.0}
    images = [
        povray_render(
            [(sphere, material)],
            [{"kind": "parallel", "direction": d, "intensity": 0.9}],
            camera,
            ambient=1.0,
        )
        for d in DIRECTIONS
    ]
    found = refine_circle(images, START, SCENES)
    assert np.abs(np.subtract(found.circle, TRUE)).max() < 0.01, found
