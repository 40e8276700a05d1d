"""Files of the page."""

import hashlib
import posixpath
import re

import pytest

from desk.server.serve import STATIC, asset_files


def test_the_vendored_library_is_unchanged():
    folder = STATIC / "vendor" / "ol"
    stated = dict(
        re.findall(r"^\| (ol\.\w+) \| ([0-9a-f]{64}) \|$", (folder / "README.md").read_text(), re.MULTILINE)
    )
    assert set(stated) == {"ol.js", "ol.css"}
    for name, digest in stated.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
    assert "BSD 2-Clause" in (folder / "LICENSE.md").read_text()


@pytest.mark.parametrize(
    "name",
    [
        "../app.py",
        "..%2f..%2fapp.py",
        "js/../../server/app.py",
        "/etc/passwd",
        "%2fetc%2fpasswd",
        "js",
        "vendor/ol/README.md",
        "",
    ],
)
def test_only_files_of_the_page_are_served(page, name):
    assert page.get(f"/static/{name}").status_code == 404


def test_every_file_that_the_page_names_is_served(page):
    html = page.get("/").text
    for address in re.findall(r'(?:src|href)="(/static/[^"]+)"', html):
        assert page.get(address).status_code == 200
    for name, file in asset_files().items():
        if file.suffix == ".js" and "vendor" not in name:
            for imported in re.findall(r'from "(\.[\w./]+)"', file.read_text()):
                served = posixpath.normpath(posixpath.join(posixpath.dirname(name), imported))
                assert served in asset_files(), f"{name} imports {imported}"


def test_the_page_asks_no_other_host():
    for name, file in asset_files().items():
        if "vendor" not in name:
            addresses = set(re.findall(r"https?://[^\s\"'`)]+", file.read_text()))
            assert addresses <= {"http://www.w3.org/2000/svg"}, name
