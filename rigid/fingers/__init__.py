"""Fingers as numbers: bones, joints and tendons."""
