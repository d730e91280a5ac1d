"""The outline of a ball in photographs without a mask."""

import numpy as np
import pytest
from mirror_scenes import unit
from shared import shared_data

from diffshade.errors import BadInput
from diffshade.io.image import read_image
from fitting.calibrate import circle_from_images, sphere_of_outline

TRUE = (80.3, 61.7, 40.4)


def ball(light: np.ndarray) -> np.ndarray:
    """A glossy ball before gray, four rays a pixel."""
    y, x = (np.mgrid[:240, :320] + 0.5) / 2
    nx, ny = (x - TRUE[0]) / TRUE[2], (TRUE[1] - y) / TRUE[2]
    hit = nx**2 + ny**2 < 1
    nz = np.sqrt(np.where(hit, 1 - nx**2 - ny**2, 0))
    n_dot_l = nx * light[0] + ny * light[1] + nz * light[2]
    r_dot_v = 2 * n_dot_l * nz - light[2]
    shade = 0.5 * n_dot_l.clip(0) + 0.6 * r_dot_v.clip(0) ** 40 * (n_dot_l > 0)
    image = np.where(hit, 0.02 + shade, 0.15)
    image[200:, 130:190] = 0.4  # a stand before it
    return image.reshape(120, 2, 160, 2).mean(axis=(1, 3))[..., None]


def test_the_rim_is_lit_by_all_lights_between_them() -> None:
    """By one light alone it is found nowhere near, or refused."""
    angles = np.arange(8) * np.pi / 4
    lights = unit(np.stack([np.cos(angles), np.sin(angles), np.ones(8)], axis=-1))
    found = circle_from_images([ball(l) for l in lights])
    assert np.abs(np.subtract(found, TRUE)).max() < 0.25, found


def test_a_small_ball_among_the_edges_of_noise(rng: np.random.Generator) -> None:
    """Before a dark background most of the edges are noise's, of which the rim's are a twelfth."""
    y, x = np.mgrid[:120, :160] + 0.5
    out = np.hypot(x - TRUE[0], y - TRUE[1]) - TRUE[2]
    image = 0.02 + 0.3 / (1 + np.exp(3 * out)) + 0.002 * rng.normal(size=out.shape)
    assert np.abs(np.subtract(circle_from_images([image[..., None]]), TRUE)).max() < 0.1


def test_noise_has_no_outline(rng: np.random.Generator) -> None:
    with pytest.raises(BadInput, match="outline"):
        circle_from_images([rng.random((100, 100, 1)) for _ in range(4)])


def test_an_outline_in_perspective() -> None:
    """The cone that touches a ball, sampled in NumPy, and a part of it that is off by a stand."""
    shape, fov, center = (200, 300), 0.9, np.array([1.2, -0.8, -5.0])
    focal = shape[0] / 2 / np.tan(fov / 2)
    axis, distance = unit(center), np.linalg.norm(center)
    first = unit(np.cross(axis, [0, 1.0, 0]))
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)[:, None]
    half = np.arcsin(1 / distance)
    circle = np.cos(angle) * first + np.sin(angle) * np.cross(axis, first)
    d = np.cos(half) * axis + np.sin(half) * circle
    points = np.stack(
        [shape[1] / 2 - focal * d[:, 0] / d[:, 2], shape[0] / 2 + focal * d[:, 1] / d[:, 2]], -1
    )
    points[:20] += 8.0
    sphere, _ = sphere_of_outline(points, shape, fov)
    np.testing.assert_allclose(sphere.center, center, atol=0.01)


@pytest.mark.slow
def test_the_probes_of_psbox_without_their_circles() -> None:
    """Against circles through a dozen points that a person clicked."""
    for probe in (1, 2):
        folder = shared_data("psbox", f"LightProbe-{probe}")
        images = [read_image(folder / f"Image_{k:02d}.JPG").values for k in range(1, 13)]
        x, y, radius = np.loadtxt(folder / "circle_data.txt")
        clicked = x - 0.5, images[0].shape[0] - y + 0.5, radius
        found = circle_from_images(images)
        assert np.abs(np.subtract(found, clicked)).max() < 0.01 * radius, found
