"""What is kept and what answers: the archive of trials, diversity, occlusion, the best grasp now."""
