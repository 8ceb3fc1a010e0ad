"""What is maximized: functions of CEC 2013 and of the UBO paper, grasps of a simulated hand, each by name."""
