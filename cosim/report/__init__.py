"""The report of runs: one HTML page, or its tables as CSV, JSON, Markdown.

`tables` makes every table that is shown, `views` and `flat` what the view in space and the strain
maps draw, `drawings` the still figures, `words` the sentences, `page` the HTML from `page.html.j2`,
`write` puts it into a file.
"""
