"""The model beside known answers: rows of `cosim verify`."""
