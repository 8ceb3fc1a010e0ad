"""One module a named method."""
