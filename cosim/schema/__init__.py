"""What every table of a case is made of: units, fields and types."""
