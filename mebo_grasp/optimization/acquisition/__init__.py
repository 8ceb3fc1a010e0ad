"""What a point is worth: acquisition functions and their maximizer."""
