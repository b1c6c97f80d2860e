"""MuJoCo's model files, written and read."""
