"""Notebooks as scripts in jupytext's percent format; `python -m cases.notebooks` renders them."""
