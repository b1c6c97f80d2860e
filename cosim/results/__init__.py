"""What a run leaves: made, written, read, drawn and compared."""
