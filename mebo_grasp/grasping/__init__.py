"""What a trial yields: hand, object, contacts and grasp metrics; the only place that imports pybullet."""
