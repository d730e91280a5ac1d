"""Every notebook: committed clean, and run from the first cell to the last in its fast mode."""

import asyncio
import re
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / "notebooks").glob("*.ipynb"))
LIMIT = 120.0
"""Seconds that one notebook may take."""

MACHINE_PATH = re.compile(r"""["'](?:/|~|[A-Za-z]:[\\/])|/(?:home|Users|root|tmp|usr|opt|mnt)/""")

pytestmark = [
    pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS]),
    # The Jupyter packages, on import: paths that they will move, which this test does not use.
    pytest.mark.filterwarnings("ignore:Jupyter is migrating its paths:DeprecationWarning"),
]


def test_there_is_a_first_one(path: Path) -> None:
    assert "first_ball" in [notebook.stem for notebook in NOTEBOOKS]
    assert path.is_file()


def test_committed_without_outputs_and_with_ids(path: Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    text = path.read_text(encoding="utf-8")
    notebook = nbformat.reads(text, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert (notebook.nbformat, notebook.nbformat_minor) == (4, 5)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}, "no widget state"
    assert dict(notebook.metadata.language_info) == {"name": "python"}, "of any version"
    assert notebook.metadata.kernelspec.name == "python3"

    ids = [cell.id for cell in notebook.cells]
    assert len(set(ids)) == len(ids)
    for cell in notebook.cells:
        assert re.fullmatch("[a-z][a-z0-9-]*[a-z]", cell.id), f"{cell.id}: a name, not a random id"
        assert cell.metadata == {}, cell.id
        assert not MACHINE_PATH.search(cell.source), f"{cell.id} holds a path of some machine"
        if cell.cell_type == "code":
            assert cell.outputs == [], cell.id
            assert cell.execution_count is None, cell.id


@pytest.mark.slow
def test_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("ipywidgets")
    monkeypatch.setenv("DIFFSHADE_NOTEBOOK_FAST", "1")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))  # not the history of who runs this
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(
        notebook,
        timeout=None,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
        extra_arguments=["--log-level=ERROR"],
    )
    asyncio.run(asyncio.wait_for(client.async_execute(), LIMIT))

    outputs = [o for cell in notebook.cells if cell.cell_type == "code" for o in cell.outputs]
    outputs += widget_outputs(notebook)
    assert any("image/png" in output.get("data", {}) for output in outputs), "no picture"
    for output in outputs:
        assert output["output_type"] != "error", output
        assert "Warning" not in output.get("text", ""), output["text"]
    if "ipywidgets" in path.read_text(encoding="utf-8"):
        assert widget_outputs(notebook), "no widget drew anything"


def widget_outputs(notebook: dict) -> list[dict]:
    """What the callbacks of widgets put out; an error there does not stop a notebook."""
    mime = "application/vnd.jupyter.widget-state+json"
    widgets = notebook["metadata"].get("widgets", {}).get(mime, {}).get("state", {})
    return [output for w in widgets.values() for output in w["state"].get("outputs", ())]
