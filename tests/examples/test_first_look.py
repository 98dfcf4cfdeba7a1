"""The notebook of the examples runs from top to bottom, in a kernel, and shows what it promises."""

import os
import signal
import tempfile
from pathlib import Path

import nbclient
import nbformat
import pytest

from motm_twin.bus.private_folder import all_running

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "examples" / "first_look.ipynb"
SCENE = ROOT / "tests" / "studies" / "half_a_metre.yaml"  # a trial of a second
SHORTER = {'run(\\"exp1\\", seed=3)': f'run(\\"{SCENE}\\", seed=3)', "SECONDS = 10.0": "SECONDS = 4.0"}


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """A folder for the notebook, in which its twin is noted; one that is left after a failure is ended."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    yield tmp_path
    for left in all_running():
        os.kill(left.pid, signal.SIGTERM)


def outputs(cell):
    return {kind: data for output in cell.outputs for kind, data in output.get("data", {}).items()}


def test_the_notebook_is_kept_without_output():
    cells = nbformat.read(NOTEBOOK, as_version=4).cells
    assert not [cell for cell in cells if cell.cell_type == "code" and (cell.outputs or cell.execution_count)]


@pytest.mark.slow
def test_the_notebook_shows_a_trial_its_plot_and_the_page(elsewhere):
    text = NOTEBOOK.read_text(encoding="utf-8")
    for whole, short in SHORTER.items():
        assert text.count(whole) == 1
        text = text.replace(whole, short)
    notebook = nbformat.reads(text, as_version=4)
    where = {"metadata": {"path": str(elsewhere)}}
    nbclient.NotebookClient(notebook, timeout=240, kernel_name="python3", resources=where).execute()
    trial, plot, link, page, end = (outputs(cell) for cell in notebook.cells if cell.cell_type == "code")
    assert "0 of 0 placed, 0 contacts" in trial["text/html"]
    assert plot["image/png"]
    assert "http://127.0.0.1:" in link["text/html"]
    assert "<iframe srcdoc=" in page["text/html"]
    assert "motm-recording" in page["text/html"]
    assert not end
    assert not [
        output for cell in notebook.cells for output in cell.get("outputs", []) if output.get("name") == "stderr"
    ]
