"""Runs a notebook, which must end with a figure.

    notebook.py NOTEBOOK
"""

import sys

import nbformat
from nbclient import NotebookClient

notebook = nbformat.read(sys.argv[1], as_version=4)
NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
if not any("image/png" in output.get("data", {}) for output in outputs):
    sys.exit(f"{sys.argv[1]} has drawn no figure")
lines = sum(bool(line) for cell in notebook.cells if cell.cell_type == "code" for line in cell.source.splitlines())
print(f"{sys.argv[1]}: {lines} lines, and a figure")
