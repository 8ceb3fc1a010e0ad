"""What is written of the scores: tables beside printed figures, plots, the page with its sets in 3-D."""
