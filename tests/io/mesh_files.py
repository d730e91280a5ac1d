"""Mesh files written by the tests, and what becomes of them."""

import pytest
import trimesh

import diffshade as ds


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def refusal(path):
    """The one line that a file is refused with; it names the file."""
    with pytest.raises(ds.BadInput) as refused:
        ds.load_mesh(path)
    (line,) = str(refused.value).splitlines()
    assert line.startswith(str(path))
    return line


def by_trimesh(path):
    return trimesh.load_scene(path, process=False).to_mesh()
