"""Functional Mock-up Units in the place of a model: a hood, a finger, a finger in motion.

`quantity` names inputs and outputs.  `archive` opens a foreign unit, `mapping` finds the port's
quantities among its variables, `unit` drives it, `kinematics` asks where a finger's bodies are;
`hood` and `finger` put it behind the port.
"""
