"""A local page to try a case by hand: controls, live residuals, the finger and its numbers."""
