"""The pictures of row S8: each is the render that its title says, and nothing else."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffshade as ds
from diffshade import gallery

BALL = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(24, 20, 2.6))
MATERIAL = ds.Material(
    ka=0.5, kd=(0.6, 0.3, 0.2), specular=ds.Phong(ks=0.3, shininess=20), od=(0.9, 0.8, 0.7)
)
LIGHTS = (
    ds.PointLight((-2, 2, 3), (1.0, 0.9, 0.8), ds.QuadraticAttenuation(1, 0.1, 0.01)),
    ds.ParallelLight((1, 0, 1), 0.5),
)
SCENE = ds.Scene(ambient=(0.1, 0.2, 0.3), lights=LIGHTS)


def image(scene: ds.Scene, material: ds.Material) -> np.ndarray:
    return np.asarray(ds.render(BALL, scene, material))


class TestComposition:
    def test_titles_in_order(self) -> None:
        titles = [title for title, _ in gallery.composition(BALL, SCENE, MATERIAL)]
        assert titles == ["ambient", "ambient + diffuse", "ambient + diffuse + specular"]

    def test_the_last_is_the_render(self) -> None:
        last = gallery.composition(BALL, SCENE, MATERIAL)[-1].image
        np.testing.assert_array_equal(last, image(SCENE, MATERIAL))

    def test_the_first_is_ia_ka_od_on_the_foreground(self, tolerance: float) -> None:
        first = np.asarray(gallery.composition(BALL, SCENE, MATERIAL)[0].image)
        expected = np.array([0.1, 0.2, 0.3]) * 0.5 * np.array([0.9, 0.8, 0.7])
        assert 0 < BALL.pixel_count < first[..., 0].size
        np.testing.assert_allclose(first, BALL.mask[..., None] * expected, rtol=tolerance)

    def test_the_second_adds_lambert(self, tolerance: float) -> None:
        """Under one parallel light of I_p = 0.5: I_a k_a O_d + I_p k_d O_d max(0, n.l)."""
        scene = ds.Scene(ambient=0.1, lights=LIGHTS[1])
        first, second, _ = (np.asarray(p.image) for p in gallery.composition(BALL, scene, MATERIAL))
        n = np.moveaxis(np.asarray(BALL.to_image((BALL.normal.x, BALL.normal.z))), -1, 0)
        n_dot_l = np.maximum((n[0] + n[1]) / np.sqrt(2), 0)[..., None]
        diffuse = 0.5 * np.array([0.54, 0.24, 0.14]) * n_dot_l
        np.testing.assert_allclose(second - first, diffuse, atol=10 * tolerance)

    def test_left_out_is_none_and_not_zero(self) -> None:
        """A coefficient of NaN shows in the pictures that have its term, and in no other."""
        broken = ds.Material(
            ka=0.5, kd=jnp.array(np.nan), specular=ds.Phong(jnp.array(np.nan), jnp.array(np.nan))
        )
        finite = [np.isfinite(p.image).all() for p in gallery.composition(BALL, SCENE, broken)]
        assert finite == [True, False, False]

    @pytest.mark.parametrize(
        ("scene", "material", "titles"),
        [
            (ds.Scene(), MATERIAL, []),
            (ds.Scene(ambient=0.1), MATERIAL, ["ambient"]),
            (ds.Scene(lights=LIGHTS), MATERIAL, ["diffuse", "diffuse + specular"]),
            (SCENE, ds.Material(kd=0.5), ["diffuse"]),
            (
                SCENE,
                ds.Material(ka=0.1, specular=ds.BlinnPhong(0.2, 30)),
                ["ambient", "ambient + specular"],
            ),
        ],
        ids=["dark", "no lights", "no ambient light", "matte", "no diffuse term"],
    )
    def test_no_picture_for_what_is_absent(
        self, scene: ds.Scene, material: ds.Material, titles: list[str]
    ) -> None:
        pictures = gallery.composition(BALL, scene, material)
        assert [title for title, _ in pictures] == titles
        if pictures:
            np.testing.assert_array_equal(pictures[-1].image, image(scene, material))


class TestLightByLight:
    def test_the_last_is_the_render_and_the_sum_of_the_others(self, tolerance: float) -> None:
        *alone, together = gallery.light_by_light(BALL, SCENE, MATERIAL)
        assert [p.title for p in alone] == ["ambient light", "light 1", "light 2"]
        assert together.title == "all together"
        np.testing.assert_array_equal(together.image, image(SCENE, MATERIAL))
        total = sum(np.asarray(p.image) for p in alone)
        np.testing.assert_allclose(total, together.image, atol=10 * tolerance)

    def test_each_light_alone_has_no_ambient_term(self) -> None:
        _, first, second, _ = gallery.light_by_light(BALL, SCENE, MATERIAL)
        for light, picture in zip(LIGHTS, (first, second), strict=True):
            expected = image(ds.Scene(lights=light), MATERIAL)
            np.testing.assert_array_equal(picture.image, expected)

    def test_no_ambient_picture_without_the_term(self) -> None:
        for scene, material in ((ds.Scene(lights=LIGHTS), MATERIAL), (SCENE, ds.Material(kd=0.5))):
            pictures = gallery.light_by_light(BALL, scene, material)
            assert [p.title for p in pictures] == ["light 1", "light 2", "all together"]


class TestVary:
    def test_each_picture_is_the_render_with_that_value(self) -> None:
        pictures = gallery.vary(
            BALL, SCENE, MATERIAL, "specular.shininess", (1, 5.0, np.float32(50))
        )
        assert [p.title for p in pictures] == ["$n = 1$", "$n = 5$", "$n = 50$"]
        for n, picture in zip((1, 5, 50), pictures, strict=True):
            material = ds.Material(
                ka=0.5, kd=MATERIAL.kd, specular=ds.Phong(0.3, n), od=MATERIAL.od
            )
            np.testing.assert_array_equal(picture.image, image(SCENE, material))

    @pytest.mark.parametrize("name", ["ka", "kd", "od", "specular.ks", "specular.0.ks"])
    def test_the_value_that_it_has_changes_nothing(self, name: str) -> None:
        values = {"ka": 0.5, "kd": (0.6, 0.3, 0.2), "od": (0.9, 0.8, 0.7)}
        (picture,) = gallery.vary(BALL, SCENE, MATERIAL, name, [values.get(name, 0.3)])
        np.testing.assert_array_equal(picture.image, image(SCENE, MATERIAL))

    def test_channels_in_the_title(self) -> None:
        (colour,) = gallery.vary(BALL, SCENE, MATERIAL, "kd", [(0.1, 0.25, 1.0)])
        assert colour.title == "$k_d = (0.1, 0.25, 1)$"

    def test_every_lobe_or_one(self) -> None:
        lobes = (ds.Phong(0.2, 10), ds.BlinnPhong(0.3, 200))
        material = ds.Material(kd=0.4, specular=lobes)
        (both,) = gallery.vary(BALL, SCENE, material, "specular.ks", [0.1])
        (second,) = gallery.vary(BALL, SCENE, material, "specular.1.ks", [0.1])
        blinn = ds.BlinnPhong(0.1, 200)
        expected = ds.Material(kd=0.4, specular=(ds.Phong(0.1, 10), blinn))
        np.testing.assert_array_equal(both.image, image(SCENE, expected))
        expected = ds.Material(kd=0.4, specular=(lobes[0], blinn))
        np.testing.assert_array_equal(second.image, image(SCENE, expected))

    @pytest.mark.parametrize("name", ["ks", "os", "specular", "specular.1.ks", "specular.alpha"])
    def test_a_coefficient_that_the_material_lacks(self, name: str) -> None:
        with pytest.raises(ds.BadInput, match=r"lacks: it has ka, kd, specular\.0\.ks"):
            gallery.vary(BALL, SCENE, MATERIAL, name, [0.1])


class TestCosinePowers:
    def test_figure_4(self, tolerance: float) -> None:
        exponents, angles = (1, 2, 5, 10, 50, 100), np.linspace(0, np.pi / 2, 91)
        curves = gallery.cosine_powers(exponents, angles)
        expected = np.cos(angles) ** np.array(exponents)[:, None]
        np.testing.assert_allclose(curves, expected, atol=10 * tolerance)
        np.testing.assert_array_equal(curves[:, 0], 1)

    def test_zero_beyond_the_right_angle(self) -> None:
        curves = gallery.cosine_powers([0.5, 3], np.radians([91.0, 135.0, 180.0]))
        np.testing.assert_array_equal(curves, np.zeros((2, 3)))


class TestCrossSection:
    @pytest.mark.parametrize("incidence", [0.0, 0.6, 1.4])
    def test_phong_about_the_mirror_direction(self, incidence: float, tolerance: float) -> None:
        angles = np.linspace(-1.5, 1.5, 41)
        found = gallery.cross_section(ds.Phong(0.4, 7), incidence, angles)
        expected = 0.4 * np.maximum(np.cos(angles - incidence), 0) ** 7
        np.testing.assert_allclose(found, expected, atol=10 * tolerance)

    def test_blinn_has_half_the_angle(self, tolerance: float) -> None:
        angles = np.linspace(-1.5, 1.5, 41)
        found = gallery.cross_section(ds.BlinnPhong(0.4, 28), 0.6, angles)
        expected = 0.4 * np.cos((angles - 0.6) / 2) ** 28
        np.testing.assert_allclose(found, expected, atol=10 * tolerance)

    def test_across_phong_is_round_and_blinn_is_not(self, tolerance: float) -> None:
        """Out of the plane by a: r.v = cos a, and n.h = cos i (1 + cos a) / |l + v|."""
        i, a = 1.2, np.linspace(-1.0, 1.0, 21)
        phong = gallery.cross_section(ds.Phong(0.4, 7), i, a, across=True)
        np.testing.assert_allclose(phong, 0.4 * np.cos(a) ** 7, atol=10 * tolerance)
        blinn = gallery.cross_section(ds.BlinnPhong(0.4, 28), i, a, across=True)
        l_v = np.cos(2 * i) * np.cos(a)
        n_h = np.cos(i) * (1 + np.cos(a)) / np.sqrt(2 + 2 * l_v)
        np.testing.assert_allclose(blinn, 0.4 * n_h**28, atol=100 * tolerance)

    @pytest.mark.parametrize("incidence", [0.0, 0.6, 1.3])
    def test_torrance_and_sparrow_by_hand(self, incidence: float, tolerance: float) -> None:
        """D G / (4 n.v) over its value for n = l = v, D a Gaussian of the angle of h, G of V-grooves."""
        i, a = incidence, np.linspace(-1.4, 1.4, 41)
        facets = ds.TorranceSparrow(0.3, 0.2)
        (straight,) = gallery.cross_section(facets, 0.0, [0.0])
        n_h, v_h = np.cos((a - i) / 2), np.cos((a + i) / 2)
        groove = np.minimum(1, 2 * n_h * np.minimum(np.cos(a), np.cos(i)) / v_h)
        expected = np.exp(-((((a - i) / 2) / 0.2) ** 2)) * groove / np.cos(a)
        found = gallery.cross_section(facets, i, a) / straight
        np.testing.assert_allclose(found, expected, atol=100 * tolerance)

    def test_channels_are_refused(self) -> None:
        for lobe in (ds.Phong((0.1, 0.2), 5), ds.GGX(0.3, 0.2, ds.Conductor((1, 2), (3, 2)))):
            with pytest.raises(ds.BadInput, match="more than one channel"):
                gallery.cross_section(lobe, 0.2, [0.1])


class TestHighlightAngle:
    def test_brute_force(self, tolerance: float) -> None:
        """By 2 (n.l) n - l, pixel by pixel, of the nearest of a point and a parallel light."""
        found = gallery.highlight_angle(BALL, SCENE)
        n, p = BALL.normal, BALL.position
        planes = (n.x, n.y, n.z, p.x, p.y, p.z)
        images = np.asarray(BALL.to_image(planes), np.float64)
        parallel = np.array([1, 0, 1]) / np.sqrt(2)
        mask = np.asarray(BALL.mask)
        for row, column in ((10, 12), (4, 9), (15, 18)):
            assert mask[row, column]
            n, p = images[row, column, :3], images[row, column, 3:]
            to_point = np.array([-2, 2, 3]) - p
            lights = (to_point / np.linalg.norm(to_point), parallel)
            mirrored = [2 * (n @ l) * n - l for l in lights]
            expected = min(np.arccos(np.clip(r[2], -1, 1)) for r in mirrored)
            assert found[row, column] == pytest.approx(expected, abs=1e4 * tolerance)
        assert np.all(found[~mask] == 0)

    def test_the_highlight_is_brightest_where_it_is_zero(self) -> None:
        scene = ds.Scene(lights=ds.ParallelLight((-0.4, 0.3, 1.0)))
        glint = image(scene, ds.Material(specular=ds.Phong(1.0, 30)))[..., 0]
        angle = np.where(BALL.mask, gallery.highlight_angle(BALL, scene), np.pi)
        assert np.argmax(glint) == np.argmin(angle)

    def test_without_lights(self) -> None:
        with pytest.raises(ds.BadInput, match="no lights with a direction"):
            gallery.highlight_angle(BALL, ds.Scene(ambient=0.1))


SLIDERS = {"ka": 0.5, "kd": 0.6, "ks": 0.3, "shininess": 20, "azimuth": 0.0, "elevation": 0.0}


class TestSliders:
    def test_directions(self, tolerance: float) -> None:
        quarter = np.pi / 2
        for angles, expected in (
            ((0.0, 0.0), (0, 0, 1)),
            ((quarter, 0.0), (1, 0, 0)),
            ((0.3, quarter), (0, 1, 0)),
            ((2 * quarter, 0.0), (0, 0, -1)),
        ):
            np.testing.assert_allclose(gallery.direction(*angles), expected, atol=tolerance)
        assert abs(np.linalg.norm(gallery.direction(0.4, -0.7)) - 1) < tolerance

    def test_it_is_the_render(self) -> None:
        picture = gallery.lit_from(BALL, **SLIDERS, ambient=0.2, intensity=0.9, od=(0.9, 0.3, 0.2))
        scene = ds.Scene(ambient=0.2, lights=ds.ParallelLight((0, 0, 1), 0.9))
        lobe = ds.Phong(ks=0.3, shininess=20)
        material = ds.Material(ka=0.5, kd=0.6, specular=lobe, od=(0.9, 0.3, 0.2))
        np.testing.assert_array_equal(picture, image(scene, material))

    @pytest.mark.parametrize(
        ("angles", "side"),
        [
            ((0.8, 0.0), "right"),
            ((-0.8, 0.0), "left"),
            ((0.0, 0.8), "top"),
            ((0.0, -0.8), "bottom"),
        ],
    )
    def test_the_light_comes_from_where_the_slider_says(
        self, angles: tuple[float, float], side: str
    ) -> None:
        azimuth, elevation = angles
        sliders = {**SLIDERS, "azimuth": azimuth, "elevation": elevation}
        picture = np.asarray(gallery.lit_from(BALL, **sliders))[..., 0]
        sides = {
            "left": picture[:, :12].sum(),
            "right": picture[:, 12:].sum(),
            "top": picture[:10].sum(),
            "bottom": picture[10:].sum(),
        }
        assert max(sides, key=sides.__getitem__) == side

    def test_dragging_never_compiles_again(self, caplog: pytest.LogCaptureFixture) -> None:
        small = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(7, 5, 2.6))
        jax.clear_caches()  # images of other tests may have had its program

        def drag(**moved: object) -> list[str]:
            caplog.clear()
            with jax.log_compiles():
                gallery.lit_from(small, **{**SLIDERS, **moved})
            return [r.getMessage() for r in caplog.records if "Compiling" in r.getMessage()]

        assert drag()
        for ka, n, azimuth in ((0, 1, 1), (0.25, 400.0, np.float64(-0.5)), (1, np.int64(7), 0.1)):
            assert drag(ka=ka, shininess=n, azimuth=azimuth) == []


def test_pictures_are_traced_like_any_render() -> None:
    """Gradients pass through a picture: d(sum of the last)/dk_a = the number of pixels times I_a O_d."""

    def total(ka: jax.Array) -> jax.Array:
        material = ds.Material(ka=ka, specular=ds.Phong(0.3, 20.0), od=(0.9, 0.8, 0.7))
        return jnp.sum(gallery.composition(BALL, SCENE, material)[-1].image)

    slope = jax.grad(total)(jnp.asarray(0.5, float))
    expected = BALL.pixel_count * (0.1 * 0.9 + 0.2 * 0.8 + 0.3 * 0.7)
    np.testing.assert_allclose(slope, expected, rtol=1e-5)
