"""Which pages are open, whether they still show what they are sent, and which are armed."""

from dataclasses import dataclass
from typing import NamedTuple

PAGE_SILENCE_S = 1.5  # a page tells of every picture that it has shown; ten of them come a second
LOOK_PAUSE_S = 0.5  # between two looks, beyond which the panel itself was held up; ten a second
MOST_PAGES = 16  # open at once: each costs a picture ten times a second
LONGEST_REASON = 150  # characters


@dataclass(eq=False)
class Page:
    """One page, from its opening to its end. Times are of the steady clock [s]."""

    address: str
    seen: float  # when it last told that it shows what it was sent; later, if that was not heard
    armed: bool = False


class Lost(NamedTuple):
    """A page that is gone, when by the clock on the wall, and why."""

    address: str
    armed: bool
    at: str
    why: str

    def __str__(self) -> str:
        armed = "an armed page" if self.armed else "a page"
        return f"{armed} ({self.address}) was lost at {self.at}: {self.why}"


def legible(reason: str) -> str:
    """A reason as it is shown to others than who gave it: one bounded line of plain characters,
    of which none turns, hides or overlays what stands beside it.
    """
    plain = "".join(one if " " <= one <= "~" else "?" for one in reason)
    return plain if len(plain) <= LONGEST_REASON else f"{plain[: LONGEST_REASON - 3]}..."


class Pages:
    """Those that are open; `lost` is the last one that is not, until another one opens."""

    def __init__(self) -> None:
        self._open: list[Page] = []
        self._looked: float | None = None  # when, for pages that are silent [s]
        self.lost: Lost | None = None

    @property
    def refusal(self) -> str:
        """Why no other page may open; empty if one may."""
        if self.count < MOST_PAGES:
            return ""
        return f"{self.count} pages are open, limit {MOST_PAGES}; close another one"

    def opened(self, address: str, now: float) -> Page:
        """A page, not armed."""
        page = Page(address, now)
        self._open.append(page)
        self.lost = None
        return page

    def closed(self, page: Page, at: str, why: str) -> Lost | None:
        """`page` has ended and is armed no more; None if that was known."""
        if not self.is_open(page):
            return None
        self._open.remove(page)
        self.lost = Lost(page.address, page.armed, at, legible(why))
        page.armed = False
        return self.lost

    def silent(self, now: float) -> list[Page]:
        """Those that have told nothing for too long, but for a time in which the panel, held up
        itself, could hear none of them.
        """
        pause = 0.0 if self._looked is None else now - self._looked
        self._looked = now
        if pause > LOOK_PAUSE_S:
            for one in self._open:
                one.seen = min(one.seen + pause, now)
        return [one for one in self._open if now - one.seen > PAGE_SILENCE_S]

    def is_open(self, page: Page) -> bool:
        """Whether `page` may still be heard."""
        return page in self._open

    @property
    def count(self) -> int:
        """Pages that are open."""
        return len(self._open)

    @property
    def armed(self) -> int:
        """Those of them that are armed."""
        return sum(page.armed for page in self._open)
