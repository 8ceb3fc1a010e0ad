"""The errors that the core raises on bad input; each message names the value, the limit and the way out."""


class MeboGraspError(Exception):
    """Base of every error raised on purpose by this package."""


class InvalidPoseError(MeboGraspError, ValueError):
    """A pose, point or rotation is not finite, not of unit norm or out of range."""


class InvalidObjectError(MeboGraspError, ValueError):
    """A target object is unknown, or its mesh cannot be loaded or has an implausible size."""


class InvalidHandError(MeboGraspError, ValueError):
    """A hand description is unknown, incomplete or inconsistent."""


class InvalidSettingsError(MeboGraspError, ValueError):
    """A setting is out of its range or contradicts another."""


class TrialStateError(MeboGraspError):
    """A trial was told twice, is unknown, or was asked for when none is left."""


class ArchiveError(MeboGraspError):
    """The archive of trials cannot be opened, read or written."""


class RunLogError(MeboGraspError):
    """The log of an optimization run cannot be read, or belongs to another run."""
