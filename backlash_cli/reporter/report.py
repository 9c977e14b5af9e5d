"""A report of any kind: what it says stands in two templates of one name, for a terminal and for a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from .json_report import header, json_text
from .page import page
from .templates import WIDTH, screen


@dataclass(frozen=True)
class Report:
    """What a command has to tell, as text, page and JSON; only the form that is asked for is worked out."""

    name: str  # of its templates, NAME.txt and NAME.html
    title: str  # of the page
    content: Mapping[str, Any]  # the values that both templates ask for
    document: Callable[[], dict[str, Any]]  # what the JSON holds
    drawn: Callable[[], Mapping[str, Any]] = dict  # the figures, and what else the page alone asks for
    subtitle: str = ""
    width: int = field(default=WIDTH, kw_only=True)  # of the text

    def text(self, *, verbose: bool = False, colour: bool = False) -> str:
        """Return what a terminal shows; `verbose`: all there is to say."""
        return screen(f"{self.name}.txt", colour=colour, width=self.width, verbose=verbose, **self.content)

    def page(self, **more: Any) -> str:
        """Return the HTML of a page; more: as `page` takes it."""
        return page(f"{self.name}.html", self.title, subtitle=self.subtitle, **{**self.content, **self.drawn(), **more})

    def json(self) -> str:
        """Return everything as strict JSON text."""
        return json_text({**header(), **self.document()})
