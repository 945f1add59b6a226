"""The notebooks of the documentation run from their first cell to their last."""

import pytest

from conftest import ROOT


@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook(path, tmp_path):
    nbformat = pytest.importorskip("nbformat", reason="no nbformat for Python")
    nbclient = pytest.importorskip("nbclient", reason="no nbclient for Python")
    pytest.importorskip("ipykernel", reason="no ipykernel for Python")
    pytest.importorskip("trimesh", reason="no trimesh for Python")
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") for cell in notebook.cells), "notebooks are kept without outputs"
    resources = {"metadata": {"path": str(tmp_path)}}
    client = nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3", resources=resources)
    client.execute()
    assert sum(len(cell.get("outputs", ())) for cell in notebook.cells) >= 2
