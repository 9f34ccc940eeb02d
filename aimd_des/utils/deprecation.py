"""How it is said that something has another name now: old names go on for two minor releases more."""

#: The version that has brought the new names.
SINCE = "0.1"
#: The version in which the old ones end.
REMOVED_IN = "0.3"


def renamed(old: str, new: str, since: str = SINCE) -> str:
    """Say that something has another name now."""
    return f"{old} is called {new} since {since}; the old name ends with {REMOVED_IN}"
