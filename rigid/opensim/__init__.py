"""OpenSim's files: models (.osim) to MJCF, tables of motions and forces (.sto, .mot)."""
