"""G-buffers in `.npz` files."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffshade.errors import BadInput
from diffshade.geometry.camera import OrthographicCamera, PerspectiveCamera
from diffshade.geometry.frequency import FlatShading
from diffshade.geometry.gbuffer import GBuffer
from diffshade.geometry.mesh import Mesh
from diffshade.geometry.sphere import Sphere
from diffshade.geometry.view import gbuffer
from diffshade.io.gbuffer import load_gbuffer, save_gbuffer

NORMAL = np.ones((4, 5, 3))
CORNERS: Any = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
FACES: Any = [[0, 1, 2], [0, 2, 3]]
SLOTS: Any = [0, 1]

GBUFFERS = {
    "orthographic": gbuffer(Sphere(), OrthographicCamera(9, 7, 3.0)),
    "perspective": gbuffer(Sphere(), PerspectiveCamera(9, 7, 0.8, position=(1, 2, 5))),
    "normals": GBuffer.from_arrays(None, NORMAL, NORMAL[..., 0] > 0, view=(0, 1, 1)),
    "slots": gbuffer(Mesh(CORNERS, FACES, slot=SLOTS), OrthographicCamera(9, 7, 3.0)),
}


@pytest.mark.parametrize("name", GBUFFERS)
def test_a_saved_gbuffer_comes_back(name: str, tmp_path: Path) -> None:
    saved = GBUFFERS[name]
    save_gbuffer(tmp_path / "g.npz", saved)
    loaded = load_gbuffer(tmp_path / "g.npz")
    assert loaded.shape == saved.shape
    assert jax.tree.structure(loaded) == jax.tree.structure(saved)
    for a, b in zip(jax.tree.leaves(loaded), jax.tree.leaves(saved), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_allclose(a, b, rtol=1e-6)
    assert [file.name for file in tmp_path.iterdir()] == ["g.npz"]


def test_plain_arrays_make_one(tmp_path: Path) -> None:
    normal = np.zeros((4, 5, 3), np.float32)
    normal[1, 2] = 0, 0, 7
    np.savez(tmp_path / "g.npz", normal=normal, position=normal)
    loaded = load_gbuffer(tmp_path / "g.npz")
    assert loaded.pixel_count == 1
    np.testing.assert_allclose(loaded.normal.z, [1], rtol=1e-6)
    assert loaded.position is not None
    assert float(loaded.position.z[0]) == 7
    np.testing.assert_array_equal(loaded.viewer.direction(None).z, jnp.ones(()))


def test_what_is_shaded_a_face_at_a_time_has_no_pixels_to_save(tmp_path: Path) -> None:
    flat = gbuffer(Mesh(CORNERS, FACES), OrthographicCamera(9, 7, 3.0), shading=FlatShading())
    with pytest.raises(BadInput, match="PhongShading"):
        save_gbuffer(tmp_path / "g.npz", flat)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arrays", "told"),
    [
        ({"normals": NORMAL}, "unknown array 'normals'"),
        ({"position": NORMAL}, "the array 'normal' is missing"),
        ({"normal": NORMAL[0]}, r"shape \(5, 3\)"),
        ({"normal": NORMAL, "position": NORMAL[1:]}, "position"),
        ({"normal": NORMAL, "mask": np.zeros((4, 5))}, "mask is empty"),
        ({"normal": NORMAL * 0}, "mask is empty"),
        ({"normal": NORMAL, "mask": np.ones((4, 6))}, r"mask has shape \(4, 6\)"),
        ({"normal": NORMAL, "position": NORMAL * np.nan}, "position is not finite"),
        ({"normal": NORMAL, "eye": np.ones(3), "view": np.ones(3)}, "give one viewer"),
        ({"normal": NORMAL, "eye": np.ones(2)}, "eye"),
        ({"normal": NORMAL, "slot": np.full((4, 5), -1)}, "slot"),
        ({"normal": NORMAL, "slot": np.ones((4, 5))}, "slot"),
        ({"normal": np.full((4, 5, 3), "up")}, "give numbers"),
        ({"normal": np.array([{}])}, "holds object values; give numbers"),
    ],
)
def test_what_is_none_is_refused(tmp_path: Path, arrays: dict[str, Any], told: str) -> None:
    path = tmp_path / "g.npz"
    np.savez(path, **arrays)
    with pytest.raises(BadInput, match=told) as caught:
        load_gbuffer(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"text", b"PK\x03\x04broken", None])
def test_other_files_are_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "g.npz"
    if content is None:
        with path.open("wb") as file:
            np.save(file, NORMAL)
    else:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=r"savez"):
        load_gbuffer(path)
    with pytest.raises(BadInput, match="no such file"):
        load_gbuffer(tmp_path / "nowhere.npz")
