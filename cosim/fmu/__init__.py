"""Functional Mock-up Units: a case's models put into one, and one put in a model's place.

`quantity` names what crosses the border.  Out: `parts` says what a written unit computes, `run`,
`fmi2` and `fmi3` run it inside a simulator, `describe` and `export` write it.  In: `archive` opens
a stranger's, `mapping` finds the port's quantities among its variables, `unit` drives it,
`participant` and `finger` put it behind the port.
"""
