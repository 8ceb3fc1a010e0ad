"""How we know: benchmarks, metrics and tables."""
