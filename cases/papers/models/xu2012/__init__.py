"""The pneumatic robotic finger: its model, pose from markers, control and experiments."""
