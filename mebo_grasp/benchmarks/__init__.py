"""What it costs and how exact it is: programs that measure the hand, the optimizers and the solution set, and print."""
