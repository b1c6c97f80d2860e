"""A judge of hand models: any model beside what was measured, and beside other models."""
