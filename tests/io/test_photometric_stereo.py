"""Folders in the photometric-stereo layout."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from capture_files import (
    HEIGHT,
    SRGB,
    WIDTH,
    codes,
    disc,
    photometric_stereo,
    refusal,
    vectors,
    write_mask,
    write_png,
)
from scipy.io import savemat
from shared import shared_data

from diffshade.errors import BadInput
from diffshade.io.capture import Capture
from diffshade.io.read_capture import read_capture

IMAGES = {"a.png": codes(1), "b b.png": codes(2)}
INTENSITIES = [(1.5, 2.0, 2.5), (0.5, 1.0, 0.75)]
DIRECTIONS = [(0.0, 0.6, 0.8), (-0.5, 0.0, 2.0)]
INSIDE = disc(8.0, 6.0, 4.6)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two images of a ball, with a mask and a circle."""
    write_mask(tmp_path / "mask.png", INSIDE)
    return photometric_stereo(
        tmp_path,
        IMAGES,
        light_directions_txt=vectors(DIRECTIONS),
        light_intensities_txt=vectors(INTENSITIES),
        sphere_json='{"cx": 7.5, "cy": 5.5, "R": 5.0}',
    )


def normals_of(capture: Capture) -> np.ndarray:
    n = capture.gbuffer.normal
    return np.asarray(capture.gbuffer.to_image((n.x, n.y, n.z)))


def test_each_image_is_divided_by_its_lights_intensity(folder: Path) -> None:
    capture = read_capture(folder)
    assert capture.names == ("a.png", "b b.png")
    for image, stored, intensity in zip(capture.images, IMAGES.values(), INTENSITIES, strict=True):
        np.testing.assert_allclose(image, stored / 65535 / np.array(intensity), rtol=3e-7)
    assert capture.fit_attenuation is None


def test_each_scene_is_one_parallel_light_and_ambient_light_of_1(folder: Path) -> None:
    for scene, direction in zip(read_capture(folder).scenes, DIRECTIONS, strict=True):
        (light,) = scene.lights
        assert float(scene.ambient) == 1
        assert float(light.intensity) == 1
        np.testing.assert_allclose(
            light.direction, direction / np.linalg.norm(direction), rtol=1e-6
        )


def test_clipping_is_decided_on_the_codes_before_the_division(folder: Path) -> None:
    image = np.full((HEIGHT, WIDTH, 3), 20000, np.uint16)
    image[6, 8] = 64224, 0, 0  # just below 0.98 * 65535 = 64224.3
    image[6, 9] = 64225, 0, 0
    image[5, 9] = 20000, 20000, 65535
    image[0, 0] = 65535  # outside the mask
    write_png(folder / "a.png", image)
    capture = read_capture(folder)
    assert np.argwhere(capture.clipped[0]).tolist() == [[5, 9], [6, 9]]
    assert not capture.clipped[1].any()
    np.testing.assert_array_equal(capture.valid[0], INSIDE & ~capture.clipped[0])
    np.testing.assert_array_equal(capture.valid[1], INSIDE)
    assert int(read_capture(folder, white=0.5).clipped[0].sum()) == 3


def test_the_circle_counts_from_the_centre_of_the_first_pixel(folder: Path) -> None:
    capture = read_capture(folder)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    nx, ny = (x - 7.5) / 5, -(y - 5.5) / 5
    truth = np.stack([nx, ny, np.sqrt(np.maximum(1 - nx**2 - ny**2, 0))], axis=-1)
    np.testing.assert_array_equal(capture.gbuffer.mask, INSIDE)
    np.testing.assert_allclose(normals_of(capture)[INSIDE], truth[INSIDE], atol=1e-6)
    position = capture.gbuffer.position
    assert position is not None
    np.testing.assert_allclose(  # in units of the radius
        position.x, capture.gbuffer.normal.x + (8 - WIDTH / 2) / 5, atol=1e-6
    )


def test_a_given_circle_goes_before_the_file_and_counts_from_the_corner(folder: Path) -> None:
    same = read_capture(folder, circle=(8.0, 6.0, 5.0))
    np.testing.assert_allclose(normals_of(same), normals_of(read_capture(folder)), atol=1e-6)
    other = read_capture(folder, circle=(8.0, 6.0, 8.0))
    assert abs(normals_of(other) - normals_of(same)).max() > 0.1


def test_measured_normals_go_before_every_circle(folder: Path) -> None:
    normals = np.zeros((HEIGHT, WIDTH, 3))
    normals[3:9, 5:11] = 0, 0.6, 0.8
    normals[4, 5] = np.nan
    savemat(folder / "Normal_gt.mat", {"Normal_gt": normals})
    capture = read_capture(folder, circle=(8.0, 6.0, 5.0))
    known = INSIDE & np.isfinite(normals).all(-1) & (normals != 0).any(-1)
    np.testing.assert_array_equal(capture.gbuffer.mask, known)
    np.testing.assert_allclose(normals_of(capture)[known], normals[known], atol=1e-6)
    assert capture.gbuffer.position is None
    assert "the given circle was not used: Normal_gt.mat goes before it" in capture.notes
    lost = int(INSIDE.sum() - known.sum())
    assert f"{lost} of the mask's {INSIDE.sum()} pixels have no geometry: left out" in capture.notes


def test_without_any_other_geometry_the_circle_comes_from_the_mask(folder: Path) -> None:
    (folder / "sphere.json").unlink()
    capture = read_capture(folder)
    assert any("found from a mask alone tends to be too large" in note for note in capture.notes)
    given = read_capture(folder, circle=(8.0, 6.0, 4.6))
    assert abs(normals_of(capture) - normals_of(given))[disc(8.0, 6.0, 3.0)].max() < 0.05


def test_without_intensities_nothing_is_divided_and_it_is_said(folder: Path) -> None:
    (folder / "light_intensities.txt").unlink()
    capture = read_capture(folder)
    np.testing.assert_allclose(capture.images[0], IMAGES["a.png"] / 65535, rtol=1e-6)
    assert any(note.startswith("light_intensities.txt is not there") for note in capture.notes)


def test_grey_images_take_one_intensity(folder: Path) -> None:
    for name, image in IMAGES.items():
        write_png(folder / name, image[..., 0])
    (folder / "light_intensities.txt").write_text("2 2 2\r\n\r\n4\r\n")
    capture = read_capture(folder)
    np.testing.assert_allclose(capture.images[0], IMAGES["a.png"][..., :1] / 65535 / 2, rtol=1e-6)
    np.testing.assert_allclose(capture.images[1], IMAGES["b b.png"][..., :1] / 65535 / 4, rtol=1e-6)


def test_a_file_that_is_display_referred_needs_the_users_word(folder: Path) -> None:
    for name, image in IMAGES.items():
        write_png(folder / name, image, chunk=SRGB)
    assert "--encoding" in refusal(folder, names=folder / "a.png")
    squared = read_capture(folder, encoding=2.0).images[0]
    np.testing.assert_allclose(squared, (IMAGES["a.png"] / 65535) ** 2 / INTENSITIES[0], rtol=1e-6)
    linear = read_capture(folder, encoding="linear")
    assert "images read as linear, against the files' own word (display)" in linear.notes


def test_pixels_that_are_not_opaque_are_not_used(folder: Path) -> None:
    image = np.concatenate(
        [IMAGES["a.png"], np.full((HEIGHT, WIDTH, 1), 65535, np.uint16)], axis=-1
    )
    image[6, 8, 3] = 30000
    write_png(folder / "a.png", image)
    capture = read_capture(folder)
    assert np.argwhere(INSIDE & ~capture.valid[0]).tolist() == [[6, 8]]
    assert not capture.clipped[0].any()


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("light_directions.txt", "0 0 1\n", "1 lights where filenames.txt names 2 images"),
        ("light_intensities.txt", "1 1 1\n", "1 lights where filenames.txt names 2 images"),
        ("light_directions.txt", "0 0 1\n\n0 nan 1\n", "light_directions.txt, line 3: "),
        ("light_directions.txt", "0 0 1\n0 0 0\n", "light_directions.txt, line 2: the light's"),
        ("light_directions.txt", "0 0 1\n0 0\n", "line 2: 2 numbers where 3 belong"),
        ("light_directions.txt", "0 0 1\n0 zero 1\n", "line 2: '0 zero 1' are not numbers"),
        ("light_intensities.txt", "1 1 1\n1 0 1\n", "line 2: an intensity is not above 0"),
        ("light_intensities.txt", "1 1 1\n1 inf 1\n", "line 2: '1 inf 1' holds NaN or infinity"),
        ("filenames.txt", "\n", "names no image"),
        ("filenames.txt", "a.png\nc.png\n", "c.png"),
        ("sphere.json", '{"cx": 1, "cy": 2}', 'the key "R" is missing'),
        ("sphere.json", '{"cx": 1, "cy": 2, "R": -3}', "R is -3; give a number above 0"),
        ("sphere.json", "{", "is not JSON"),
        ("sphere.json", '{"cx": 900, "cy": 2, "R": 3}', "has no pixel inside the mask"),
        ("Normal_gt.mat", "no", "is not a MATLAB file"),
        ("a.png", "this is text", "not an image"),
        ("mask.png", "this is text", "not an image"),
    ],
)
def test_what_cannot_be_used_is_refused(folder: Path, file: str, text: str, told: str) -> None:
    (folder / file).write_text(text)
    # A name that is listed but not there is the image's, not the list's.
    named = folder / ("c.png" if "c.png" in text else file)
    assert told in refusal(folder, names=named)


def test_sizes_that_differ_are_refused_with_both(folder: Path) -> None:
    write_png(folder / "b b.png", codes(3, (HEIGHT, WIDTH + 1, 3)))
    told = refusal(folder, names=folder / "b b.png")
    assert "17 x 12 pixels of 3 channels" in told
    assert str(folder / "a.png") in told
    assert "16 x 12" in told


def test_a_mask_and_normals_of_another_size_are_refused(folder: Path) -> None:
    write_mask(folder / "mask.png", np.ones((HEIGHT + 1, WIDTH), bool))
    assert "16 x 13 pixels where" in refusal(folder, names=folder / "mask.png")
    write_mask(folder / "mask.png", INSIDE)
    savemat(folder / "Normal_gt.mat", {"Normal_gt": np.ones((HEIGHT, WIDTH + 2, 3))})
    assert "18 x 12 pixels where" in refusal(folder, names=folder / "Normal_gt.mat")
    savemat(folder / "Normal_gt.mat", {"N": np.ones((HEIGHT, WIDTH, 3))})
    assert "it holds N" in refusal(folder, names=folder / "Normal_gt.mat")


def test_an_empty_mask_is_refused(folder: Path) -> None:
    write_mask(folder / "mask.png", np.zeros((HEIGHT, WIDTH), bool))
    assert "empty" in refusal(folder, names=folder / "mask.png")


def test_a_mask_that_is_no_ball_is_refused_without_other_geometry(folder: Path) -> None:
    (folder / "sphere.json").unlink()
    write_mask(folder / "mask.png", np.pad(np.ones((4, 12), bool), ((4, 4), (2, 2))))
    assert "not the outline of a ball" in refusal(folder, names=folder / "mask.png")
    (folder / "mask.png").unlink()
    assert "no geometry" in refusal(folder)


def test_images_that_are_clipped_everywhere_are_refused(folder: Path) -> None:
    for name in IMAGES:
        write_png(folder / name, np.full((HEIGHT, WIDTH, 3), 65535, np.uint16))
    assert "every pixel of the mask is clipped" in refusal(folder, names="a.png")


def test_a_folder_or_file_that_is_no_capture_is_refused(tmp_path: Path) -> None:
    assert "holds neither capture.toml nor filenames.txt" in refusal(tmp_path)
    (tmp_path / "ball.LP").write_text("")
    assert "it holds ball.LP" in refusal(tmp_path)
    assert "no such file or folder" in refusal(tmp_path / "nowhere")
    (tmp_path / "list.csv").write_text("")
    assert "is not a capture" in refusal(tmp_path / "list.csv")


def test_wrong_options_are_refused(folder: Path) -> None:
    assert "--white 2" in refusal(folder, names=folder, white=2.0)
    assert "is no circle" in refusal(folder, names="--circle", circle=(1.0, 2.0, 0.0))
    with pytest.raises(BadInput, match="encoding is 'sRGB'"):
        read_capture(folder, encoding="sRGB")


def test_the_ball_of_diligent() -> None:
    capture = read_capture(shared_data("diligent_ball"))
    assert len(capture.names) == 24
    assert capture.images[0].shape == (172, 172, 3)
    assert all(clipped.any() for clipped in capture.clipped)
    assert [int(c.sum()) for c in capture.clipped[:3]] == [11, 16, 9]
    assert capture.gbuffer.pixel_count == 15791
    intensity = np.array([1.2909, 1.5776, 2.1336])
    brightest = capture.images[0].reshape(-1, 3).max(0) * intensity
    np.testing.assert_allclose(brightest, 1, rtol=1e-6)  # at 65535 in the highlight's core


def test_the_circle_of_the_ball_is_that_of_its_normals(tmp_path: Path) -> None:
    ball = shared_data("diligent_ball")
    for file in ball.iterdir():
        if file.name not in ("Normal_gt.mat", "sphere.json"):
            (tmp_path / file.name).symlink_to(file)
    measured = normals_of(read_capture(ball))

    def mean_degrees() -> float:
        capture = read_capture(tmp_path, allow_outside=True)  # of links
        inside = np.asarray(capture.gbuffer.mask)
        cosine = (normals_of(capture) * measured).sum(-1)[inside]
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())

    assert 0.1 < mean_degrees() < 0.3  # found from the mask: the README's 0.24
    (tmp_path / "sphere.json").symlink_to(ball / "sphere.json")
    assert mean_degrees() < 0.01


def test_the_cat_of_diligent() -> None:
    capture = read_capture(shared_data("diligent_cat"))
    assert len(capture.names) == 20
    assert not any(clipped.any() for clipped in capture.clipped)
    assert not any("plateau" in note for note in capture.notes)
    assert jnp.isfinite(capture.gbuffer.normal.z).all()
