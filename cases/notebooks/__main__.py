"""Run the notebooks and render each as a page: `python -m cases.notebooks [FOLDER] [NAME ...]`.

Needs `pip install '.[notebooks]'`.  A page holds all that it shows and calls nothing from the net;
what a notebook writes is gone with the folder that it ran in.
"""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent
FROM_THE_NET = (
    "mathjax_url",
    "require_js_url",
    "jquery_url",
    "mermaid_js_url",
    "widget_renderer_url",
)
"""What nbconvert's pages would load; none of ours needs it."""


def main(folder: Path, names: list[str]) -> None:
    """Write a page of each notebook to `folder`, of those named alone where there are any."""
    import jupytext
    from nbconvert import HTMLExporter
    from nbconvert.preprocessors import ExecutePreprocessor

    folder.mkdir(parents=True, exist_ok=True)
    exporter = HTMLExporter(**dict.fromkeys(FROM_THE_NET, ""))
    for source in sorted(HERE.glob("[!_]*.py")):
        if names and source.stem not in names:
            continue
        notebook = jupytext.read(source)
        run = ExecutePreprocessor(timeout=600, kernel_name="python3")
        with TemporaryDirectory() as place:
            run.preprocess(notebook, {"metadata": {"path": place}})
        page, _ = exporter.from_notebook_node(notebook)
        target = folder / f"{source.stem}.html"
        target.write_text(page, encoding="utf-8")
        print(target)


if __name__ == "__main__":
    parser = ArgumentParser("python -m cases.notebooks", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("notebooks"), metavar="FOLDER")
    parser.add_argument("names", nargs="*", metavar="NAME", help="of a notebook; none: all")
    given = parser.parse_args()
    main(given.folder, given.names)
