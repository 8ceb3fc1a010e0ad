"""What a trial yields: hand, object, contacts and grasp metrics; the only place that imports pybullet."""

from pathlib import Path

from mebo_grasp.compiled_code import discard_stale_code

discard_stale_code(Path(__file__).parent)
