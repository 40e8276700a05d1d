"""Reference of file formats, from the registries of readers and writers."""

from sim.cli.guide.topics import _formats


def pages() -> dict[str, str]:
    """Return the page of file formats."""
    return {"reference/file-formats.md": "# File formats\n\n```text\n" + _formats() + "\n```\n"}
