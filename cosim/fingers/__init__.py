"""Fingers: what a case may say of one, and how it is built."""
