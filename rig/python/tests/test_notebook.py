"""The example notebook, run from its first cell to its last."""

import os
from pathlib import Path

import pytest


@pytest.mark.skipif("RIG_RUN" not in os.environ, reason="RIG_RUN names no run folder")
def test_the_notebook_runs():
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("pandas")
    notebook = nbformat.read(Path(__file__).parents[1] / "examples" / "run.ipynb", as_version=4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(notebook, timeout=120).execute()
    shown = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert len(shown) == 5 and all(output.output_type == "execute_result" for output in shown), shown
