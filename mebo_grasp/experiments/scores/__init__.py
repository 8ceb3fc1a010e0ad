"""Numbers read of finished runs: metrics, sets, tests of significance."""
