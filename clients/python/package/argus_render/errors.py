"""Exceptions. All are an ArgusError."""

from __future__ import annotations


class ArgusError(Exception):
    """Why there is no answer."""

    #: Position of the failed frame among the poses of its call; None if the error is not one frame's.
    index: int | None = None


class InvalidField(ArgusError, ValueError):
    """An argument, or a field of a request, cannot be used."""

    #: Name of the argument, or path of the field, such as ``camera.fov_deg``.
    field: str
    #: What is wrong with it.
    reason: str

    def __init__(self, field: str, reason: str) -> None:
        super().__init__(field, reason)
        self.field, self.reason = field, reason

    def __str__(self) -> str:
        return f"{self.field}: {self.reason}"


class Unavailable(ArgusError, ConnectionError):
    """No service answers, or it has nobody who could answer now. The same request may succeed later."""


class TimedOut(ArgusError, TimeoutError):
    """No answer came in the time that the caller gave."""


class Overloaded(ArgusError):
    """The service refuses more requests for now."""

    #: Seconds after which the service expects to have room; None if it does not say.
    retry_after: float | None

    def __init__(self, message: str, retry_after: float | None) -> None:
        super().__init__(message, retry_after)
        self.retry_after = retry_after

    def __str__(self) -> str:
        return str(self.args[0])


class NotAllowed(ArgusError, PermissionError):
    """The service does not allow the request, or the two sides do not trust each other."""


class Incompatible(ArgusError):
    """What answers is no Argus service, or is of another version."""


class Damaged(ArgusError):
    """The answer was damaged on its way, repeatedly, or does not match the request."""


class ServerError(ArgusError):
    """The service failed in another way, which it reports."""
