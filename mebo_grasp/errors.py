"""The errors that the core raises on bad input; each message names the value, the limit and the way out."""


class MeboGraspError(Exception):
    """Base of every error raised on purpose by this package."""


class InvalidPoseError(MeboGraspError, ValueError):
    """A pose, point or rotation is not finite, not of unit norm or out of range."""


class InvalidObjectError(MeboGraspError, ValueError):
    """A target object is unknown, or its mesh cannot be loaded or has an implausible size."""


class InvalidHandError(MeboGraspError, ValueError):
    """A hand description is unknown, incomplete or inconsistent."""


class InvalidQualityError(MeboGraspError, ValueError):
    """The figures of a grasp under noise contradict each other or are not finite."""


class InvalidSettingsError(MeboGraspError, ValueError):
    """A setting is out of its range or contradicts another."""


class TrialStateError(MeboGraspError):
    """A trial was told twice, is unknown, or was asked for when none is left."""


class ArchiveError(MeboGraspError):
    """The archive of trials cannot be opened, read or written."""


class InvalidOcclusionError(MeboGraspError, ValueError):
    """An occluding shape has a size that is not finite and positive, or an occlusion has no usable name."""


class InvalidQueryError(MeboGraspError, ValueError):
    """A request to the solution set holds a number that is out of range."""


class InvalidFrameError(MeboGraspError, ValueError):
    """A transform between frames lacks a name, or names one frame twice."""


class InvalidFileError(MeboGraspError, ValueError):
    """A file of trials cannot be read or written; the message names the file and the line."""


class InvalidMessageError(MeboGraspError, ValueError):
    """A message holds a value that the receiver cannot use."""


class WrongFrameError(InvalidMessageError):
    """A message is given in another frame than the one expected; both are named."""


class RunLogError(MeboGraspError):
    """The log of an optimization run cannot be read, or belongs to another run."""


def os_error_text(error: OSError) -> str:
    """Return in one line what the operating system refused, with the way out where it names a file."""
    if error.filename is None:  # such as a disk that is full when a file is written
        return error.strerror or str(error)
    return f"cannot use '{error.filename}': {error.strerror}; name another place"
