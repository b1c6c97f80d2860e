"""Material laws and sections."""
