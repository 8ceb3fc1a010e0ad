"""What is kept and what answers: the archive of trials, diversity, occlusion, the best grasp now."""

from pathlib import Path

from mebo_grasp.compiled_code import discard_stale_code

discard_stale_code(Path(__file__).parent)
