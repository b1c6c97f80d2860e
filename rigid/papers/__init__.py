"""Studies of papers about rigid fingers."""
