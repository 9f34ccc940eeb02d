"""Systems to allocate for: each a function, registered by name, that returns a `Problem`."""

from models.smart_cameras import smart_cameras

__all__ = ["smart_cameras"]
