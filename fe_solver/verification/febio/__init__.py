"""Our answers and costs beside FEBio's."""
