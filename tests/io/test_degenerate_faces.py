"""Faces without area are left out, and whoever reads the mesh is told how many there are."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import SIZE, image_entry, light, scene
from mesh_files import written

import diffshade as ds
from diffshade.cli import run
from diffshade.io.image import write_png

DIRECTION = (0.2, 0.1, 1.0)
SPOILT = """
v -1 -1 0\nv 1 -1 0\nv 1 1 0.3\nv -1 1 0.3\nv 0 0 0.15
f 1 2 3\nf 1 3 4
f 1 1 2\nf 1 3 5\nf 2 2 2
"""
"""Two faces, and three without area: an edge, three corners on one line, a point."""
TOLD = "3 of 5 faces have no area: left out"
MESH = '{ kind = "mesh", file = "a.obj" }'


def test_load_mesh_warns(tmp_path: Path) -> None:
    path = written(tmp_path, "a.obj", SPOILT)
    with pytest.warns(UserWarning, match=f"a.obj: {TOLD}") as caught:
        mesh = ds.load_mesh(path)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert mesh.degenerate().tolist() == [False, False, True, True, True]
    camera = ds.OrthographicCamera(SIZE, SIZE, 2.2)
    image = ds.render(
        ds.gbuffer(mesh, camera), ds.Scene(lights=ds.ParallelLight(DIRECTION)), ds.Material(kd=1.0)
    )
    assert np.isfinite(np.asarray(image)).all()
    assert float(image.max()) > 0.9


def test_render_notes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path, "a.obj", SPOILT)
    path = written(tmp_path, "scene.toml", scene(DIRECTION, geometry=MESH))
    assert run(["render", str(path), "--out", str(tmp_path / "a.exr")]) == 0
    assert capsys.readouterr().err == f"diffshade: a.obj: {TOLD}\n"


@pytest.mark.slow
def test_fit_notes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path, "a.obj", SPOILT)
    write_png(tmp_path / "0.png", np.full((SIZE, SIZE), 0.5), bits=16)
    lines = [
        'schema = "diffshade.capture/1"',
        'encoding = "linear"',
        f"geometry = {MESH}",
        f'camera = {{ kind = "orthographic", width = {SIZE}, height = {SIZE}, extent = 2.2 }}',
        image_entry("0.png", light(DIRECTION)),
    ]
    path = written(tmp_path, "capture.toml", "\n".join(lines))
    assert run(["fit", str(path), "--model", "lambert", "--json"]) == 0
    assert f"a.obj: {TOLD}" in json.loads(capsys.readouterr().out)["notes"]
