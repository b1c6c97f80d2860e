"""OpenSim's tables from FEBio's reactions, and tensions from OpenSim's tables."""
