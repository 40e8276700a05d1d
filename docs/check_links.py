"""Check the built pages: every internal link has a target, and nothing is loaded from a network.

``python -m docs.check_links docs/_build/html`` prints what is wrong and ends with 1 where anything is.
"""

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADING = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src", "video": "src"}
_LINK_KINDS = {"stylesheet", "icon", "preload", "shortcut"}


class Page(HTMLParser):
    """Anchors, links and loaded files of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: set[str] = set()
        self.loaded: set[str] = set()
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note anchors and addresses of a tag."""
        values = dict(attrs)
        self.anchors |= {value for name in ("id", "name") if (value := values.get(name))}
        if tag == "a" and (target := values.get("href")):
            self.links.add(target)
        kinds = set((values.get("rel") or "stylesheet").split())
        if (
            tag in _LOADING
            and (target := values.get(_LOADING[tag]))
            and (tag != "link" or kinds & _LINK_KINDS)
        ):
            self.loaded.add(target)


@cache
def page_of(file: Path) -> Page:
    """Return a parsed page."""
    return Page(file)


def pages_in(folder: Path) -> list[Path]:
    """Return the pages below a folder; templates of the theme are none."""
    return sorted(file for file in folder.rglob("*.html") if file.relative_to(folder).parts[0] != "_static")


def faults(folder: Path) -> list[str]:
    """Return one sentence for each broken link and each file that a page loads from elsewhere."""
    found = []
    for file in pages_in(folder):
        page, name = page_of(file), file.relative_to(folder)
        found += [
            f"{name} loads {url}" for url in sorted(page.loaded) if urlsplit(url).scheme in ("http", "https")
        ]
        found += [
            f"{name} links to {url}, which is not there"
            for url in sorted(page.links | page.loaded)
            if is_broken(file, url)
        ]
    return found


def is_broken(file: Path, url: str) -> bool:
    """Return whether a link of a page leads to a file or anchor that does not exist."""
    parts = urlsplit(url)
    if parts.scheme or parts.netloc:
        return False
    target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
    if not target.is_file():
        return True
    return (
        target.suffix == ".html"
        and bool(parts.fragment)
        and unquote(parts.fragment) not in page_of(target).anchors
    )


def main() -> None:
    """Print the faults of a folder of pages."""
    folder = Path(sys.argv[1]).resolve()
    found = faults(folder)
    n_pages = len(pages_in(folder))
    print("\n".join([*found, f"{n_pages} pages, {len(found)} broken links"]))  # noqa: T201
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
