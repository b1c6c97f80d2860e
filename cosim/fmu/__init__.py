"""Functional Mock-up Units: a case's models put into one, and one put in a model's place.

`quantity` names what crosses the border.  Out: `parts` and `moving_parts` say what a written unit
computes, `run`, `state`, `fmi2` and `fmi3` run it inside a simulator, `describe` and `export` write
it.  In: `archive` opens a stranger's, `mapping` finds the port's quantities among its variables,
`unit` drives it, `kinematics` asks where a finger's bodies are, `participant`, `finger` and
`moving` put it behind the port, `settle` runs a case whose finger at rest it is.
"""
