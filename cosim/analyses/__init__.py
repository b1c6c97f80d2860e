"""What asks a case many questions."""
