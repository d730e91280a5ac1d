"""Whole images: against the plain reference, and the laws that a composition obeys."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from compilations import compilations

import diffshade as ds

SPHERE = {"kind": "sphere", "center": (0.1, -0.2, 0.3), "radius": 0.9}
CAMERAS = {
    "orthographic": {"kind": "orthographic", "width": 40, "height": 32, "extent": 2.6},
    "perspective": {
        "kind": "perspective",
        "width": 40,
        "height": 32,
        "fov": 0.6,
        "position": (1.0, 0.5, 4.0),
        "target": (0.1, 0.0, 0.0),
        "up": (0.0, 1.0, 0.1),
    },
}
LIGHTS = [
    {"kind": "point", "position": (1, 2, 3), "intensity": (0.9, 0.8, 0.7)},
    {
        "kind": "point",
        "position": (-2, 1, 2),
        "intensity": (0.5, 0.6, 0.7),
        "attenuation": {"c0": 0.4, "c1": 0.1, "c2": 0.1},
    },
    {"kind": "parallel", "direction": (0.3, -0.4, 1.0), "intensity": (0.2, 0.3, 0.1)},
]
MATERIAL = {"ka": (0.2, 0.1, 0.3), "kd": (0.6, 0.5, 0.1), "ks": (0.5, 0.4, 0.3), "shininess": 17.5}


def ours(camera: dict) -> tuple[ds.GBuffer, ds.Scene, ds.Material]:
    built = {k: v for k, v in camera.items() if k != "kind"}
    kind = ds.OrthographicCamera if camera["kind"] == "orthographic" else ds.PerspectiveCamera
    gbuffer = ds.gbuffer(ds.Sphere(SPHERE["center"], SPHERE["radius"]), kind(**built))
    lights = (
        ds.PointLight((1, 2, 3), (0.9, 0.8, 0.7)),
        ds.PointLight((-2, 1, 2), (0.5, 0.6, 0.7), ds.QuadraticAttenuation(0.4, 0.1, 0.1)),
        ds.ParallelLight((0.3, -0.4, 1.0), (0.2, 0.3, 0.1)),
    )
    lobe = ds.Phong(ks=MATERIAL["ks"], shininess=MATERIAL["shininess"])
    material = ds.Material(ka=MATERIAL["ka"], kd=MATERIAL["kd"], specular=lobe)
    return gbuffer, ds.Scene(ambient=0.4, lights=lights), material


@pytest.mark.parametrize("camera", CAMERAS)
def test_against_the_plain_reference(camera: str) -> None:
    """NumPy, one light after the other, [..., 3] arrays: the same image."""
    gbuffer, scene, material = ours(CAMERAS[camera])
    image = np.asarray(ds.render(gbuffer, scene, material))
    expected = reference.render([(SPHERE, MATERIAL)], LIGHTS, CAMERAS[camera], ambient=0.4)
    seen = np.any(expected > 0, axis=-1)
    if jax.config.jax_enable_x64:
        np.testing.assert_array_equal(gbuffer.mask, seen)
    both = gbuffer.mask & seen
    allowed = 1e-12 if jax.config.jax_enable_x64 else 3e-4
    np.testing.assert_allclose(image[both], expected[both], atol=allowed)
    assert np.all(image[~gbuffer.mask] == 0)


def test_outermost_and_nested_calls_agree(tolerance: float) -> None:
    gbuffer, scene, material = ours(CAMERAS["orthographic"])
    outermost = ds.render(gbuffer, scene, material)
    nested = jax.jit(ds.render)(gbuffer, scene, material)
    np.testing.assert_allclose(outermost, nested, atol=10 * tolerance)


def test_repeated_calls_do_not_compile_again() -> None:
    """Plain numbers became arrays when the objects were built."""
    gbuffer, scene, _ = ours(CAMERAS["orthographic"])
    ds.render(gbuffer, scene, ds.Material(kd=0.5, specular=ds.Phong(0.5, 10.0)))
    with compilations() as compiled:
        for k in range(3):
            ds.render(gbuffer, scene, ds.Material(kd=0.1 * k, specular=ds.Phong(k, 10 + k)))
    assert not compiled


def test_object_colours_multiply(tolerance: float) -> None:
    """I = I_a k_a O_d + I_p f [k_d O_d n.l + k_s O_s (r.v)^n] (text C)."""
    gbuffer, scene, material = ours(CAMERAS["orthographic"])
    od, os = np.array([0.9, 0.5, 0.3]), np.array([0.2, 0.7, 1.0])
    lobe = material.specular[0]
    coloured = ds.Material(material.ka, material.kd, lobe, od=od, os=os)
    multiplied = ds.Material(
        np.asarray(material.ka) * od,
        np.asarray(material.kd) * od,
        ds.Phong(np.asarray(lobe.ks) * os, lobe.shininess),
    )
    np.testing.assert_allclose(
        ds.render(gbuffer, scene, coloured),
        ds.render(gbuffer, scene, multiplied),
        atol=10 * tolerance,
    )


def test_the_image_is_the_contraction_of_its_basis(tolerance: float) -> None:
    gbuffer, scene, material = ours(CAMERAS["orthographic"])
    planes = ds.contract(ds.basis(gbuffer, scene, material), material)
    np.testing.assert_allclose(
        gbuffer.to_image(planes), ds.render(gbuffer, scene, material), atol=10 * tolerance
    )


def test_maps_of_coefficients(tolerance: float) -> None:
    """A coefficient may be a plane over the foreground; a constant plane is the constant."""
    gbuffer, scene, material = ours(CAMERAS["orthographic"])
    p = gbuffer.pixel_count
    lobe = material.specular[0]

    def spread(numbers: jax.Array) -> jax.Array:
        return jnp.broadcast_to(jnp.atleast_1d(numbers)[:, None], (numbers.size, p))

    maps = ds.Material(
        spread(material.ka), spread(material.kd), ds.Phong(spread(lobe.ks), spread(lobe.shininess))
    )
    np.testing.assert_allclose(
        ds.render(gbuffer, scene, maps), ds.render(gbuffer, scene, material), atol=10 * tolerance
    )


def test_nothing_lit_is_black_and_a_number_fills_the_foreground() -> None:
    gbuffer, _, _ = ours(CAMERAS["orthographic"])
    dark = ds.render(gbuffer, ds.Scene(), ds.Material(kd=0.5))
    assert dark.shape == (32, 40, 1)
    assert not np.any(dark)
    ambient = ds.render(gbuffer, ds.Scene(ambient=0.5), ds.Material(ka=(0.2, 0.4)))
    inside = np.asarray(gbuffer.mask)
    np.testing.assert_allclose(ambient[inside], [[0.1, 0.2]] * inside.sum(), rtol=1e-6)
    assert not np.any(np.asarray(ambient)[~inside])


def test_several_lobes_add_up(tolerance: float) -> None:
    gbuffer, scene, _ = ours(CAMERAS["orthographic"])
    lobes = (ds.Phong(0.3, 200.0), ds.BlinnPhong((0.1, 0.2, 0.3), 8.0))
    together = ds.render(gbuffer, scene, ds.Material(specular=lobes))
    apart = sum(ds.render(gbuffer, scene, ds.Material(specular=lobe)) for lobe in lobes)
    np.testing.assert_allclose(together, apart, atol=10 * tolerance)


def test_materials_by_slot(tolerance: float) -> None:
    """Every face has the coefficients of its slot."""
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    mesh = ds.Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), slot=np.array([0, 1]))
    gbuffer = ds.gbuffer(mesh, ds.OrthographicCamera(16, 16, 2.2))
    scene = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    materials = (
        ds.Material(kd=(0.6, 0.1, 0.2), specular=ds.Phong(0.2, 10.0)),
        ds.Material(kd=0.5, specular=ds.Phong((0.0, 0.1, 0.3), 99.0)),
    )
    image = np.asarray(ds.render(gbuffer, scene, materials))
    each = [np.asarray(ds.render(gbuffer, scene, m)) for m in materials]
    slot = np.asarray(gbuffer.to_image((gbuffer.slot,)))[..., 0]
    for number in (0, 1):
        here = gbuffer.mask & (slot == number)
        assert here.sum() > 50
        np.testing.assert_allclose(image[here], each[number][here], atol=10 * tolerance)

    one = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.2))
    with pytest.raises(ds.BadInput, match="2 materials"):
        ds.render(one, scene, materials)
    with pytest.raises(ds.BadInput, match="different terms"):
        ds.render(gbuffer, scene, (materials[0], ds.Material(kd=0.5)))


@pytest.mark.parametrize("lobe", [ds.Phong, ds.BlinnPhong])
def test_no_light_leaks_from_behind(lobe: type) -> None:
    """Text A's program tests neither n.l < 0 nor r.v < 0; both are dark, for any n."""
    gbuffer = ds.GBuffer.from_arrays(None, np.tile([0.0, 0.0, 1.0], (1, 1, 1)))
    for n in (0.5, 1.0, 2.0, 7.3):
        material = ds.Material(kd=0.5, specular=lobe(0.5, n))
        for direction in ((0.6, 0, -0.8), (0, 0, -1), (1, 0, 0)):
            image = ds.render(gbuffer, ds.Scene(lights=ds.ParallelLight(direction)), material)
            assert np.asarray(image).item() == 0


def test_the_exponents_of_phong_and_blinn_phong_differ_by_four() -> None:
    """Near the highlight n.h turns half as fast as r.v: (n.h)^(4n) is (r.v)^n to second order."""
    angles = np.linspace(0, 0.15, 16)
    normals = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)[None]
    gbuffer = ds.GBuffer.from_arrays(None, normals)
    scene = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    phong = ds.render(gbuffer, scene, ds.Material(specular=ds.Phong(1.0, 20.0)))
    blinn = ds.render(gbuffer, scene, ds.Material(specular=ds.BlinnPhong(1.0, 80.0)))
    same = ds.render(gbuffer, scene, ds.Material(specular=ds.BlinnPhong(1.0, 20.0)))
    assert np.abs(phong - blinn).max() < 0.03
    assert np.abs(phong - same).max() > 0.3


def test_concrete_inputs_inside_jit_and_scan(tolerance: float) -> None:
    """What is closed over is a value, and yet the call is not outermost."""
    gbuffer, scene, material = ours(CAMERAS["orthographic"])
    expected = 2 * np.asarray(ds.render(gbuffer, scene, material))
    jitted = jax.jit(lambda k: k * ds.render(gbuffer, scene, material))(jnp.asarray(2.0))
    np.testing.assert_allclose(jitted, expected, atol=10 * tolerance)
    _, scanned = jax.lax.scan(
        lambda c, k: (c, k * ds.render(gbuffer, scene, material)), 0.0, jnp.array([2.0])
    )
    np.testing.assert_allclose(scanned[0], expected, atol=10 * tolerance)


@pytest.mark.parametrize("where", ["shininess", "position", "c0", "kd"])
def test_nan_stays_nan(where: str) -> None:
    """A guard makes singular points harmless, and never hides what is wrong from the start."""
    gbuffer, _, _ = ours(CAMERAS["orthographic"])
    nan = jnp.asarray(jnp.nan, float)
    numbers = {
        "shininess": jnp.asarray(5.0),
        "position": jnp.ones(3) * 2,
        "c0": jnp.asarray(1.0),
        "kd": jnp.asarray(0.5),
    }
    numbers[where] = numbers[where] + nan

    def image(n: dict) -> jax.Array:
        light = ds.PointLight(n["position"], 1.0, ds.QuadraticAttenuation(n["c0"]))
        material = ds.Material(kd=n["kd"], specular=ds.Phong(0.5, n["shininess"]))
        return ds.render(gbuffer, ds.Scene(lights=light), material).sum()

    assert np.isnan(image(numbers))
    if where != "kd":  # in which the image is linear
        assert np.isnan(np.asarray(jax.grad(image)(numbers)[where])).all()


def test_maps_and_materials_that_do_not_fit_are_refused() -> None:
    gbuffer, scene, _ = ours(CAMERAS["orthographic"])
    with pytest.raises(ds.BadInput, match="foreground pixels"):
        ds.render(gbuffer, scene, ds.Material(kd=np.ones((1, 7))))
    with pytest.raises(ds.BadInput, match="kd has shape"):
        ds.Material(kd=np.ones((4, 4, 1)))
    with pytest.raises(ds.BadInput, match="cannot be negative"):
        ds.Phong(0.5, -1.0)
    with pytest.raises(ds.BadInput, match=r"kd is '0.5'"):
        ds.Material(kd="0.5")  # type: ignore[arg-type]
    with pytest.raises(ds.BadInput, match="no materials"):
        ds.render(gbuffer, scene, [])
    mesh = ds.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]], slot=np.array([2]))
    seen = ds.gbuffer(mesh, ds.OrthographicCamera(8, 8, 2.2))
    with pytest.raises(ds.BadInput, match="slot 2 of 2 materials"):
        ds.render(seen, scene, (ds.Material(kd=0.1), ds.Material(kd=0.2)))
