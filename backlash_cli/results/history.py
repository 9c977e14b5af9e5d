"""What the history holds and what follows from it: nights, repairs, wear, and the order of repair.

Times are UTC epoch seconds, dead bands in spans of the controller output, slopes in spans per day."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field

import numpy as np

from ..record import Frozen, Note
from .scan import Verdict

DAY = 86400.0


def day_of(time: float) -> str:
    """Return the UTC calendar day of a time in epoch seconds, as ISO 8601."""
    return str(np.datetime64(int(time // DAY), "D"))


def missing_days(covered: Iterable[str]) -> list[str]:
    """Return the days between the first and the last covered one that are not covered."""
    days = np.array([*covered], "datetime64[D]")
    return list(map(str, np.setdiff1d(np.arange(days.min(), days.max()), days))) if len(days) else []


class Night(Frozen):
    """One scanned export of one loop."""

    loop: str
    start: float
    end: float
    verdict: Verdict
    confidence: float = 0.0
    d: float | None = None  # None where the verdict gives no size
    ci95: tuple[float, float] | None = None
    source: str = ""  # of d: "confirmation" (measurement against output) or "cluster" (half periods)
    limit_of_detection: float | None = None  # smallest dead band that this night could have shown
    samples: int = 0
    interval_s: float | None = None
    half_periods: int = 0
    detections: int = 0
    travel: float | None = None  # of the output [spans/h]
    settings: Mapping[str, object] = field(default_factory=dict)
    reasons: tuple[Note, ...] = ()
    warnings: tuple[Note, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict)
    digest: str = ""  # fingerprint of everything stored for this night

    @property
    def time(self) -> float:
        """Middle of the export, the time that stands for the night."""
        return 0.5 * (self.start + self.end)

    @property
    def below_detection(self) -> bool:
        """Whether the night says only that the dead band is below its limit of detection."""
        return self.d is None and self.verdict is Verdict.NO_BACKLASH and self.limit_of_detection is not None


class Repair(Frozen):
    """A repair of a valve."""

    loop: str
    time: float
    note: str = ""
    found: bool = False  # seen in the data instead of entered by a person
    before: float | None = None
    after: float | None = None


class Segment(Frozen):
    """Wear between two repairs: its nights, the slope, and the fitted dead band at both ends."""

    first: float  # night
    last: float
    nights: int  # with a size
    below: int = 0  # below the limit of detection
    slope: float | None = None  # mean over the last month, or all days where there are fewer
    slope_ci95: tuple[float, float] | None = None  # None with too few nights
    level_first: float = 0.0
    level: float = 0.0  # at the last night
    level_ci95: tuple[float, float] = (0.0, 0.0)
    path: tuple[tuple[float, ...], ...] = ()  # (time, dead band, low, high) at every night

    @property
    def growing(self) -> bool:
        """Whether the dead band grows for sure: the whole interval of the slope is above zero."""
        return self.slope_ci95 is not None and self.slope_ci95[0] > 0


class HeldOut(Frozen):
    """How a straight line and a trend that may bend foresaw the last nights, from the nights before alone."""

    nights: int  # so many were hidden
    since: str  # day of the first of them
    straight_line_error: float  # median
    local_error: float  # of the trend that may bend
    straight_line_bias: float  # median of nights less line, positive where the line is too low
    straight_line_holds: bool  # it foresaw them as well


class Limit(Frozen):
    """Largest dead band that a class of loops may have, and who says so."""

    value: float
    name: str
    source: str


class Wear(Frozen):
    """The wear of one loop: its segments, the repairs between them, and when the limit is reached."""

    loop: str
    nights: Sequence[Night] = field(repr=False)  # in time order
    limit: Limit
    state: str  # "growing", "no_trend", "too_few_nights" or "no_estimate"
    segments: tuple[Segment, ...] = ()
    repairs: tuple[Repair, ...] = ()
    limit_date: tuple[float, float, float] | None = None  # (value, early, late) where a trend reaches the limit
    earliest: float | None = None  # where no trend reaches the limit: the day before which it is not reached
    gaps: tuple[tuple[str, str], ...] = ()  # (day, code of the reason) where a scan gave no size
    missing_days: tuple[str, ...] = ()  # days between the first and the last night without any export
    model: str = ""  # what the date comes from: "line" (straight) or "local" (a trend that may bend), if any
    held_out: HeldOut | None = None  # the two compared, None with too few nights
    forecast: tuple[tuple[float, ...], ...] = ()  # (time, dead band, low, high) to a date ahead

    @property
    def now(self) -> Segment | None:
        """The segment since the last repair, None where nothing has been measured since."""
        return None if self.state == "no_estimate" else self.segments[-1]


class Place(Frozen):
    """A place in the order of repair: what to do with the valve, and what decided."""

    wear: Wear
    loop: str
    rank: int
    action: str  # "pull", "room", "watch", "leave" or "check"
    confidence: float
    ratio_to_limit: float | None  # of the dead band
    nights: int  # the last ones since the repair; `silent` of them saw no dead band, in `swinging` the loop oscillated
    silent: int
    swinging: int
    codes: tuple[str, ...]  # why the last nights gave no size
    travel: float  # factor of the score: above 1 the valve moves more than most
    days_left: float  # until the limit is reached, from the last night of the plant on
    horizon: float  # days that the plan must cover


def gone(places: Iterable[Place], days: float) -> list[str]:
    """Return the loops that were there in the last `days`, but not in the last night."""
    ends = {place.loop: place.wear.nights[-1].end for place in places if place.wear.nights}
    return sorted(loop for loop, end in ends.items() if 0.75 * DAY < max(ends.values()) - end < days * DAY)
