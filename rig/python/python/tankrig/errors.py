"""What may go wrong, by the classes that the command line's exit codes have."""

from __future__ import annotations

__all__ = ["RigError", "InternalError", "InputError", "HardwareError", "HeldError", "DataError", "Interrupted", "MissingPackage"]


class RigError(Exception):
    """Something that ``rig`` could not do; the text says what was tried, on what, and what to do.

    Attributes:
        status: the class in a word, as ``--json`` says it.
        exit_code: what the command line would exit with.
    """

    status: str = "internal-error"
    exit_code: int = 1


class InternalError(RigError):
    """Our fault."""


class InputError(RigError, ValueError):
    """The input, a config or an argument is wrong."""

    status = "input-error"
    exit_code = 2


class HardwareError(RigError):
    """A servo board, a camera or the recording failed."""

    status = "hardware-fault"
    exit_code = 3


class HeldError(HardwareError):
    """The rig is held, and nothing may move."""

    status = "held"


class DataError(RigError):
    """The data cannot answer what was asked."""

    status = "data-cannot-answer"
    exit_code = 4


class MissingPackage(RigError, ImportError):
    """A package that this needs and that is not installed."""

    status = "input-error"
    exit_code = 2


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended a fit or a diagnosis.

    Attributes:
        best: the best so far, a ``Fit`` or ``Diagnosis``; ``None`` where there was none yet.
    """

    def __init__(self, text: str = "", best: object = None) -> None:
        super().__init__(text)
        self.best = best


_BY_STATUS = {cls.status: cls for cls in (InternalError, InputError, HardwareError, HeldError, DataError)}


def of_status(status: str, text: str) -> BaseException:
    """The exception of the class that is called ``status``."""
    if status == "interrupted":
        return Interrupted(text)
    return _BY_STATUS.get(status, InternalError)(text)
