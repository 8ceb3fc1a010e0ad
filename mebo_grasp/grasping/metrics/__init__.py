"""Metrics beyond the basic ones of ``quality``, one module a family; each is defined in docs/grasp_metrics.md."""
