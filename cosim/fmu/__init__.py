"""Functional Mock-up Units in the place of a model: a hood, a finger, a finger in motion.

`quantity` names what crosses the border.  `archive` opens a stranger's unit, `mapping` finds the
port's quantities among its variables, `unit` drives it, `kinematics` asks where a finger's bodies
are; `hood` and `finger` put it behind the port.
"""
