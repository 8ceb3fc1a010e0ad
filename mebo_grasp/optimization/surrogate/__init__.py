"""What is believed about the objective: kernels, Gaussian process, hyperparameters."""
