"""Where to try next: surrogate, acquisition, selection and the ask/tell optimizer; knows no ROS."""
