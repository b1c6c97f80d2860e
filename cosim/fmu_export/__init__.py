"""A case's models as Functional Mock-up Units.

`part`, `static_parts` and `motion_parts` say what a written unit computes; `run`,
`state`, `hooks`, `fmi2` and `fmi3` run it inside a simulator; `describe` and `write` write it.
"""
