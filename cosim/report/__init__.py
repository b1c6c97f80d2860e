"""The pages of HTML, and the report of runs as CSV, JSON or Markdown.

`html_page` of `templates` makes every page, in the frame `base.html.j2` and the style `page.css`.
Of a report, `tables` makes every table that is shown, `views` and `flat` what the view in space and
the strain maps draw, `drawings` the still figures, `words` the sentences, `page` the HTML and the
file.  `lesion_page` is the report of a lesion.  `figures` is a page of pictures and tables, and
`gallery` makes one of a script with cells, as those of `cases/papers/`.
"""
