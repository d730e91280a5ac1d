"""Every notebook: committed clean, and run from the first cell to the last in its fast mode."""

import re
import time
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.output_widget import OutputWidget

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / "notebooks").glob("*.ipynb"))
LIMIT = 120
"""Seconds that one notebook may take; a cell that takes as long is named in the failure."""

MACHINE_PATH = re.compile(r"""["'](?:/|~|[A-Za-z]:[\\/])|/(?:home|Users|root|tmp|usr|opt|mnt)/""")

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])


def test_the_first_notebook_is_there() -> None:
    assert "first_ball" in [path.stem for path in NOTEBOOKS]


@each_notebook
def test_committed_without_outputs_and_with_ids(path: Path) -> None:
    notebook = nbformat.read(path, as_version=nbformat.NO_CONVERT)
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
@pytest.mark.notebook
@each_notebook
def test_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DIFFSHADE_NOTEBOOK_FAST", "1")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))  # not the history of who runs this
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(
        notebook,
        timeout=LIMIT,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
        extra_arguments=["--log-level=ERROR"],
    )
    client.widget_registry["@jupyter-widgets/output"]["OutputModel"] = SilentOutput
    start = time.monotonic()
    client.execute()
    assert time.monotonic() - start < LIMIT

    drawn = widget_outputs(notebook)
    outputs = [o for cell in notebook.cells if cell.cell_type == "code" for o in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs), "no picture"
    if "ipywidgets" in path.read_text(encoding="utf-8"):
        assert any("image/png" in output.get("data", {}) for output in drawn), "no widget's picture"
    for output in outputs + drawn:
        assert output["output_type"] != "error", output
        assert "Warning" not in output.get("text", ""), output["text"]


class SilentOutput(OutputWidget):
    """The output of a widget, kept and not sent back to the kernel.

    What nbclient sends back while it waits for the kernel's reply makes it miss that reply now and
    then, and wait until the time limit (nbclient issue 312).
    """

    def send(self, *args: object, **kwargs: object) -> None:
        pass


def widget_outputs(notebook: nbformat.NotebookNode) -> list[dict]:
    """What the callbacks of widgets put out; an error there does not stop a notebook."""
    mime = "application/vnd.jupyter.widget-state+json"
    widgets = notebook.metadata.get("widgets", {}).get(mime, {}).get("state", {})
    return [output for w in widgets.values() for output in w["state"].get("outputs", ())]
