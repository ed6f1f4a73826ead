"""Detection: the believed model beside the plant, and tests of what is left."""
