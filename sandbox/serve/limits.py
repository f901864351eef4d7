"""How much browsers may ask for. A page in use stays far below; what is beyond is not heard, or not kept."""

from dataclasses import dataclass

CLIENTS = 32
"""Browsers that look at once, where nothing else is said."""
MOST_CLIENTS = 256
"""Browsers that can be let look at once: each takes a file descriptor, and a share of the processor."""
OPENING = 64
"""Connections that are no browser's yet: those that ask for the page, or for nothing."""
MESSAGES = 400
"""A second and browser, and at once. A page sends 50 a second while it orbits, 20 while it drags or slides."""
FRAMES = 4000
"""A second and connection, of any kind: who sends more is cut off."""
TOGETHER, FAIR = 3000, 100
"""Of all connections a second; where more come, who sends more than its fair share is cut off."""
CONTROL = 20
"""Frames of these that are pings, answers to pings or goodbyes: pages cannot send the first."""
BYTES = 1 << 20
"""A second and connection: who sends more is cut off. Messages of a page have 80 to 260."""
MESSAGE_SIZE = 1 << 16
"""[bytes]"""
FRAGMENTS = 16
"""Frames that a message may come in."""
REQUEST_SIZE = 1 << 15
"""Of the head of a request [bytes]."""
TEXT = 256
"""Characters of a text field."""
REQUEST_TIME, PAGE_TIME = 10.0, 60.0
"""For a request to be whole, and for the page to be fetched [s]."""
NEWCOMER = 10.0
"""How long a browser that says nothing keeps its place where others want in [s]: pages say where their camera is."""
PING, PATIENCE = 4.0, 12.0
"""How often a browser is asked whether it is still there, and how long an answer, or taking anything, may take [s]."""
LEAST_TAKEN = 1 << 15
"""What a browser that has not kept up must at least take within its time [bytes]."""
UNSENT = 1 << 23
"""What those that fetch the page may together leave untaken [bytes]. Browsers leave a picture each at most."""
STEPS = 8
"""Clicks on Step that may wait."""
DEEDS = 100_000
"""Changes and places of hands that a recording takes."""


@dataclass
class Bucket:
    """Lets things through at a rate: ``room`` of them at once, and as many again every second."""

    room: float
    _left: float = -1.0
    _looked: float = 0.0

    def take(self, now: float, count: float = 1.0) -> bool:
        """Whether so many may pass at a time [s]."""
        left = self.room if self._left < 0.0 else self._left
        self._left = min(self.room, left + self.room * max(0.0, now - self._looked))
        self._looked = now
        if count > self._left:
            return False
        self._left -= count
        return True


def in_words(clients: int = CLIENTS) -> str:
    """The limits, for people."""
    return (
        f"Limits: {clients} browsers at once (--clients), {OPENING} connections that are none yet. Of each browser "
        f"{MESSAGES} messages a second are heard; who sends {FRAMES:,} or {BYTES >> 20} MB a second is cut off, and so "
        f"is who sends more than {FAIR} while all together send more than {TOGETHER:,}. A message has at most "
        f"{MESSAGE_SIZE >> 10} KB, a request {REQUEST_SIZE >> 10} KB, a text {TEXT} characters. Requests have "
        f"{REQUEST_TIME:g} s to be whole, the page {PAGE_TIME:g} s to be fetched; a browser that takes nothing for "
        f"{PATIENCE:g} s is cut off, one that says nothing for {NEWCOMER:g} s makes room for others. {STEPS} clicks on "
        f"Step wait, of other controls the newest; a recording takes {DEEDS:,} changes and places of hands."
    )
