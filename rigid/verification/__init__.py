"""The verification of the finger's parts: closed forms, published curves and OpenSim's figures."""
