"""G-buffers in EXR files: with the layers of Blender by name, and of Mitsuba by Mitsuba."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from handmade import write_channels
from mitsuba_scalar import mitsuba

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.io.exr import read_channels
from diffshade.io.exr_gbuffer import load_exr_gbuffer, save_exr_gbuffer

BALL = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(9, 7, 3.0))


def image(planes: Any, gbuffer: ds.GBuffer = BALL) -> np.ndarray:
    return np.asarray(gbuffer.to_image((planes.x, planes.y, planes.z)), np.float32)


def blender(folder: Path, index: str = "IndexOB", **changes: np.ndarray) -> Path:
    """As Blender's multi-layer output has it, view layer, pass, axis; with the passes that it adds."""
    mask = np.asarray(BALL.mask)
    numbers = np.where(mask, 3, 0).astype(np.float32)
    numbers[mask & (np.arange(9) > 4)] = 17
    passes: dict[str, np.ndarray] = {
        "Combined.R": numbers,
        "Combined.G": numbers,
        "Combined.B": numbers,
        "Combined.A": np.ones((7, 9), np.float32),
        "Depth.Z": np.full((7, 9), 1e10, np.float32),
        f"{index}.X": numbers,
    }
    for name, values in (("Position", image(BALL.position)), ("Normal", image(BALL.normal))):
        passes |= {f"{name}.{axis}": values[..., k].copy() for k, axis in enumerate("XYZ")}
    passes |= changes
    return write_channels(folder / "b.exr", {f"ViewLayer.{k}": v for k, v in passes.items()})


@pytest.mark.parametrize("index", ["IndexOB", "Object Index"])
def test_blenders_passes(index: str, tmp_path: Path) -> None:
    found = load_exr_gbuffer(blender(tmp_path, index), eye=(0, 0, 5))
    np.testing.assert_array_equal(found.gbuffer.mask, BALL.mask)
    np.testing.assert_allclose(image(found.gbuffer.normal), image(BALL.normal), atol=1e-6)
    np.testing.assert_allclose(image(found.gbuffer.position), image(BALL.position), atol=1e-6)
    assert found.indices == (3, 17)
    column = np.nonzero(np.asarray(BALL.mask))[1]
    np.testing.assert_array_equal(found.gbuffer.slot, column > 4)
    told = "the indices 3, 17 are slots 0 to 1 here: give materials in this order"
    assert found.notes == (told,)


def test_each_index_has_a_material(tmp_path: Path) -> None:
    found = load_exr_gbuffer(blender(tmp_path))
    flat = ds.Material(ka=0.25), ds.Material(ka=0.75)
    drawn = np.asarray(ds.render(found.gbuffer, ds.Scene(ambient=1.0), flat))[..., 0]
    np.testing.assert_allclose(drawn[3, [2, 6]], [0.25, 0.75])


def test_mixed_indices_are_left_out(tmp_path: Path) -> None:
    mask = np.asarray(BALL.mask)
    numbers = np.where(mask, 3, 0).astype(np.float32)
    numbers[3, 4], numbers[3, 5] = 2.5, -1
    found = load_exr_gbuffer(blender(tmp_path, **{"IndexOB.X": numbers}))
    assert "2 pixels" in found.notes[0]
    assert found.gbuffer.pixel_count == BALL.pixel_count - 2
    assert not np.asarray(found.gbuffer.mask)[3, 4:6].any()


@pytest.mark.parametrize("samples", [1, 16])
def test_mitsubas_aovs_by_mitsuba(samples: int, tmp_path: Path) -> None:
    mi = mitsuba()
    pose = mi.ScalarTransform4f().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": 12, "height": 10, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "integrator": {"type": "aov", "aovs": "pp:position,nn:sh_normal,id:shape_index"},
        "sensor": {
            "type": "orthographic",
            "to_world": pose @ mi.ScalarTransform4f().scale([1.5, 1.5, 1]),
            "film": {**film, "pixel_format": "rgb"},
            "sampler": {"type": "multijitter", "sample_count": samples},
        },
        "ball": {"type": "sphere", "radius": 1.0},
    }
    loaded = mi.load_dict(scene)
    mi.render(loaded)
    loaded.sensors()[0].film().bitmap().write(str(tmp_path / "m.exr"))
    found = load_exr_gbuffer(tmp_path / "m.exr")
    place = image(found.gbuffer.position, found.gbuffer)
    normal = image(found.gbuffer.normal, found.gbuffer)
    inside = np.asarray(found.gbuffer.mask)
    assert found.indices == (1,)
    if samples == 1:  # somewhere in the pixel
        np.testing.assert_allclose(place[inside], normal[inside], atol=1e-5)
        assert not any("mean of several" in note for note in found.notes)
        x = (np.nonzero(inside)[1] + 0.5 - 6) / 4
        y = (5 - np.nonzero(inside)[0] - 0.5) / 4
        assert np.abs(place[inside][:, 0] - x).max() < 0.126
        assert np.abs(place[inside][:, 1] - y).max() < 0.126
    else:  # means over the edge are no index
        assert "mean of several" in found.notes[0]


def test_layers_of_any_name(tmp_path: Path) -> None:
    channels = {f"my.{axis}": image(BALL.normal)[..., k] for k, axis in enumerate("XYZ")}
    write_channels(tmp_path / "a.exr", {name: c.copy() for name, c in channels.items()})
    found = load_exr_gbuffer(tmp_path / "a.exr", normal="my", view=(0, 1, 1))
    np.testing.assert_array_equal(found.gbuffer.mask, BALL.mask)
    assert found.gbuffer.position is None
    assert found.gbuffer.slot is None
    with pytest.raises(BadInput, match=r"no layer of normals; name it, of: my \[X Y Z\]"):
        load_exr_gbuffer(tmp_path / "a.exr")
    with pytest.raises(BadInput, match="no layer 'mine' with X Y Z for the normal"):
        load_exr_gbuffer(tmp_path / "a.exr", normal="mine")
    with pytest.raises(BadInput, match="no layer 'mine' with X for the index"):
        load_exr_gbuffer(tmp_path / "a.exr", normal="my", index="mine")
    with pytest.raises(BadInput, match="an eye needs positions"):
        load_exr_gbuffer(tmp_path / "a.exr", normal="my", eye=(0, 0, 5))


def test_what_is_written_is_read_again_under_blenders_names(tmp_path: Path) -> None:
    corners: Any = [[-1, -1, 0], [1, -1, 0], [1, 1, 0.5], [-1, 1, 0]]
    faces: Any = [[0, 1, 2], [0, 2, 3]]
    slots: Any = [0, 1]
    saved = ds.gbuffer(ds.Mesh(corners, faces, slot=slots), ds.OrthographicCamera(9, 7, 3.0))
    save_exr_gbuffer(tmp_path / "a.exr", saved)
    assert set(read_channels(tmp_path / "a.exr")) == {
        *(f"ViewLayer.{name}.{axis}" for name in ("Normal", "Position") for axis in "XYZ"),
        "ViewLayer.IndexOB.X",
    }
    found = load_exr_gbuffer(tmp_path / "a.exr")
    np.testing.assert_array_equal(found.gbuffer.mask, saved.mask)
    np.testing.assert_array_equal(found.gbuffer.slot, saved.slot)
    np.testing.assert_allclose(
        image(found.gbuffer.position, found.gbuffer), image(saved.position, saved), atol=1e-6
    )
    flat = ds.gbuffer(
        ds.Mesh(corners, faces), ds.OrthographicCamera(9, 7, 3.0), shading=ds.FlatShading()
    )
    with pytest.raises(BadInput, match="PhongShading"):
        save_exr_gbuffer(tmp_path / "b.exr", flat)
    assert [file.name for file in tmp_path.iterdir()] == ["a.exr"]
