"""Our models as Functional Mock-up Units."""
