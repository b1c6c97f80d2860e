"""Run the notebooks and render each as a page: `python -m cases.notebooks [FOLDER]`.

Needs `pip install '.[notebooks]'`.
"""

from __future__ import annotations

import sys
from pathlib import Path


def main(folder: Path) -> None:
    """Write a page of each notebook to `folder`, run there."""
    import jupytext
    from nbconvert import HTMLExporter
    from nbconvert.preprocessors import ExecutePreprocessor

    folder.mkdir(parents=True, exist_ok=True)
    for source in sorted(Path(__file__).parent.glob("[!_]*.py")):
        notebook = jupytext.read(source)
        run = ExecutePreprocessor(timeout=600, kernel_name="python3")
        run.preprocess(notebook, {"metadata": {"path": str(folder)}})
        page, _ = HTMLExporter().from_notebook_node(notebook)
        target = folder / f"{source.stem}.html"
        target.write_text(page, encoding="utf-8")
        print(target)


main(Path(sys.argv[1] if len(sys.argv) > 1 else "notebooks"))
