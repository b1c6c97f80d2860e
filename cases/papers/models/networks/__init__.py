"""Studies of tendon networks."""
