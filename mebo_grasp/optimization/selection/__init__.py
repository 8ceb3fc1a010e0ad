"""Which points form a batch."""
