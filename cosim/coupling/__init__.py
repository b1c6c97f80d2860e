"""A finger and a hood solved together, at rest and in time, over the port only."""
