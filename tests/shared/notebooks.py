"""Executes the notebooks of examples; run as a program, it stores their output anew."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

NOTEBOOKS = sorted(Path(__file__).parents[2].glob("examples/notebooks/*.ipynb"))


def executed(path: Path, folder: Path) -> list:
    """The cells of a notebook after all of them ran in a folder, and the whole notebook's text."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    place = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=300, record_timing=False, resources=place).execute()
    return [notebook.cells, nbformat.writes(notebook) + "\n"]


def text_of(cells: list) -> list[str]:
    """What the cells of code show as text, in the order of the notebook."""
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    texts = [output.get("text") or output["data"]["text/plain"] for output in outputs]
    return ["".join(text) for text in texts]


if __name__ == "__main__":
    for path in NOTEBOOKS:
        with tempfile.TemporaryDirectory() as folder:
            path.write_text(executed(path, Path(folder))[1], encoding="utf-8")
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB", file=sys.stderr)
