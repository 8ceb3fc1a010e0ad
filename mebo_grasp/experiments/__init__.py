"""How good the methods are: experiments from a definition through runs and scores to a report."""
