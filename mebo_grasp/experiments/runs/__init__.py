"""Making runs: jobs, in parallel processes or on a cluster, every step logged, continued after a kill."""
