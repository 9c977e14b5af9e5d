"""A report of any kind: what it says stands in two templates of one name, for a terminal and for a page."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

from .._version import __version__
from ..record import Frozen
from .files import write_text
from .json_report import header, json_text
from .page import BACK, is_page, page, write_pages
from .safe import shorten
from .templates import WIDTH, screen


class LoopPart(Frozen):
    """One loop of a report on many: mark and one line on it, the template of its part, and what makes its content."""

    name: str
    mark: str
    brief: str
    template: str
    content: Callable[[], Mapping[str, Any]]


class Report(Frozen):
    """What a command has to tell, as text, page and JSON; only the form that is asked for is worked out."""

    name: str  # of its templates, NAME.txt and NAME.html
    title: str  # of the page
    content: Mapping[str, Any]  # the values that both templates ask for
    document: Callable[[], dict[str, Any]] = dict  # what the JSON holds
    drawn: Callable[[], Mapping[str, Any]] = dict  # the figures, and what else the page alone asks for
    subtitle: str = ""
    width: int = field(default=WIDTH, kw_only=True)  # of the text
    loops: Callable[[], Sequence[LoopPart]] = field(default=tuple, kw_only=True)  # parts below the page

    def text(self, *, verbose: bool = False, colour: bool = False) -> str:
        """Return what a terminal shows; `verbose`: all there is to say."""
        return screen(f"{self.name}.txt", colour=colour, width=self.width, verbose=verbose, **self.content)

    def page(self, **more: Any) -> str:
        """Return the HTML of one page, every loop folded below the overview; more: as `page` takes it."""
        if loops := self.loops():
            more |= {"overview": f"{self.name}.html", "loops": loops,
                     "links": {one.name: f"#loop-{i}" for i, one in enumerate(loops)}}
        return page("loops.html" if loops else f"{self.name}.html", self.title, subtitle=self.subtitle,
                    **{**self.content, **self.drawn(), **more})

    def write(self, output: Path, told: object, step: Callable[[], None] = lambda: None) -> None:
        """Write that page, or for a name without .html a folder: index.html and a page per loop, loaded when opened.
        told: tells this report from others. step: called after each page."""
        def pages() -> Iterator[tuple[str, dict[str, str]]]:
            for one in loops:
                yield one.name, {"html": page(one.template, shorten(one.name, 120), subtitle=one.brief,
                                              x=one.content(), **BACK)}
                step()

        if is_page(output):
            write_text(output, self.page())
            return
        loops = self.loops()
        write_pages(output, (__version__, told), [one.name for one in loops], pages(), lambda **where: page(
            f"{self.name}.html", self.title, subtitle=self.subtitle, **self.content, **self.drawn(), **where))

    def json(self) -> str:
        """Return everything as strict JSON text."""
        return json_text({**header(), **self.document()})
