"""The pages of HTML, and the report of runs as CSV, JSON or Markdown.

`base.html.j2` is the frame of every page and `page.css` its style; `templates` finds them.  Of a
report, `tables` makes every table that is shown, `views` and `flat` what the view in space and the
strain maps draw, `drawings` the still figures, `words` the sentences, `page` the HTML, `write` the
file.  `lesion_page` is the report of a lesion.  `figures` is a page of pictures and tables, and
`gallery` makes one of a script with cells, as those of `cases/papers/`.
"""
