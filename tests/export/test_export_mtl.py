"""`.mtl` files as they are written, read by readers that know nothing of the writer."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trimesh.exchange.obj import parse_mtl

import diffshade as ds
from diffshade.errors import BadInput
from diffshade.export.mtl import as_mtl, write_mtl
from diffshade.io.mtl import read_mtl

PHONG = ds.Material((0.1, 0.05, 0.02), (0.5, 0.3, 0.1), ds.Phong((0.3, 0.2, 0.1), 32.0))


def by_obj(folder: Path, materials: dict[str, ds.Material]) -> tuple[Any, ...]:
    """The materials of an OBJ file beside the library."""
    write_mtl(folder / "a.mtl", materials)
    faces = "".join(f"usemtl {name}\nf 1 2 3\n" for name in materials)
    (folder / "a.obj").write_text(f"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}")
    return ds.load_mesh(folder / "a.obj").materials


def test_phong_comes_back_as_four_times_the_exponent_of_blinn(tmp_path: Path) -> None:
    (read,) = by_obj(tmp_path, {"shiny": PHONG})
    np.testing.assert_allclose(read.ka, PHONG.ka, rtol=1e-6)
    np.testing.assert_allclose(read.kd, PHONG.kd, rtol=1e-6)
    (lobe,) = read.specular
    assert isinstance(lobe, ds.BlinnPhong)
    np.testing.assert_allclose(lobe.ks, PHONG.specular[0].ks, rtol=1e-6)
    assert float(lobe.shininess) == pytest.approx(128.0, rel=1e-6)


def test_the_file_says_what_was_converted_and_how_far_it_is_off() -> None:
    export = as_mtl(PHONG)
    comments = [line for line in export.text.splitlines() if line.startswith("#")]
    assert any("Ks (r.v)^32" in line and "4 times the exponent" in line for line in comments)
    for row in (export.error.relative_rms, export.error.largest):
        stated = ", ".join(f"{x:.2g}" for x in row)
        assert any(stated in line for line in comments)
    assert 1e-4 < export.error.relative_rms[0] < 0.01
    assert 0.1 < export.error.relative_rms[3] < 0.5


def test_blinn_is_written_as_it_is(tmp_path: Path) -> None:
    blinn = ds.Material(0.1, 0.5, ds.BlinnPhong(0.25, 77.0))
    export = write_mtl(tmp_path / "a.mtl", blinn)["material"]
    assert max(export.error.relative_rms) < 1e-6
    assert export.notes == ()
    assert read_mtl(tmp_path / "a.mtl")["material"].ns == 77


def test_trimesh_reads_the_same() -> None:
    read = parse_mtl(as_mtl(PHONG, "my own").text)
    assert list(read) == ["my own"]
    own = read["my own"].kwargs if hasattr(read["my own"], "kwargs") else read["my own"]
    np.testing.assert_allclose(own["kd"], PHONG.kd, rtol=1e-6)
    np.testing.assert_allclose(own["ks"], PHONG.specular[0].ks, rtol=1e-6)
    assert float(own["Ns"] if "Ns" in own else own["ns"]) == pytest.approx(128)


def test_several_materials_and_terms_that_are_not_there(tmp_path: Path) -> None:
    matt, black = ds.Material(kd=0.5, od=(1.0, 0.5, 0.0)), ds.Material(specular=ds.Phong(0.5, 9))
    write_mtl(tmp_path / "a.mtl", {"matt": matt, "black": black})
    read = read_mtl(tmp_path / "a.mtl")
    assert read["matt"].kd == (0.5, 0.25, 0)
    assert (read["matt"].ka, read["matt"].illum) == ((0, 0, 0), 1)
    assert (read["black"].kd, read["black"].illum) == ((0, 0, 0), 2)
    text = (tmp_path / "a.mtl").read_text()
    assert text.count("written by diffshade") == 1
    assert "no Ka and no Ks: 0 stands" in text


def test_other_lobes_become_the_nearest() -> None:
    alpha = np.sqrt(2 / 202)
    facets = as_mtl(ds.Material(specular=ds.GGX(0.2, alpha, ds.Dielectric())))
    lines = dict(line.split(" ", 1) for line in facets.text.splitlines() if line[0] != "#")
    assert float(lines["Ns"]) == pytest.approx(200, rel=1e-5)
    peak = 0.2 * 0.04 / (4 * np.pi * alpha**2)
    np.testing.assert_allclose(float(lines["Ks"].split()[0]), peak, rtol=1e-5)
    two = as_mtl(ds.Material(specular=(ds.BlinnPhong(0.3, 398), ds.BlinnPhong(0.1, 38))))
    lines = dict(line.split(" ", 1) for line in two.text.splitlines() if line[0] != "#")
    # 4 pi k / (n + 2), the light of each in light from above, together
    assert 0.4 / (float(lines["Ns"]) + 2) == pytest.approx(0.3 / 400 + 0.1 / 40, rel=1e-5)
    assert "2 lobes are written as one" in two.notes[0]
    weighed = as_mtl(ds.Material(specular=ds.BlinnPhong(0.5, 40, ds.Schlick(0.2))))
    assert "Ks 0.1 0.1 0.1" in weighed.text


def test_a_body_is_seen_head_on() -> None:
    plastic = ds.Material(kd=0.5, body=ds.FresnelBody(1.5))
    assert "Kd 0.4608 0.4608 0.4608" in as_mtl(plastic).text  # 0.5 (1 - 0.04)^2


@pytest.mark.parametrize(
    ("material", "name", "told"),
    [
        (ds.Material(kd=np.ones((3, 4))), "a", "one material at a time"),
        (ds.Material(kd=(0.1, 0.2)), "a", "three for red, green and blue"),
        (ds.Material(kd=0.5), "a\nb", "in one line"),
        (ds.Material(kd=0.5), " ", "in one line"),
    ],
)
def test_what_cannot_be_written_is_refused(
    material: ds.Material, name: str, told: str, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match=told):
        write_mtl(tmp_path / "a.mtl", {name: material})
    with pytest.raises(BadInput, match="at least one"):
        write_mtl(tmp_path / "a.mtl", {})
    assert not list(tmp_path.iterdir())
