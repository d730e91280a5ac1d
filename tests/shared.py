"""Data that lie beside the repository, not in it: photographs, meshes, published values."""

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[1].parent / "shared"


def shared_data(*parts: str) -> Path:
    """A file or folder of the shared data; the test that asks is skipped where it is absent."""
    path = SHARED.joinpath("data", *parts)
    if not path.exists():
        pytest.skip(f"{'/'.join(parts)} is absent: the shared data are not beside the repository")
    return path
