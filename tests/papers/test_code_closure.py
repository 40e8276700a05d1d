"""Digest of the code that a function depends on, in small checkouts."""

from textwrap import dedent

import pytest

from papers.code_closure import Code

START = "benchmarks.heights:measure"
FILES = {
    "benchmarks/heights.py": '''
        """A benchmark."""
        from survey import Grid
        from survey.noise import drawn
        COMMAND = ["python", "-m", "firnline", "plan", "site.geojson"]
        PROGRAM = "import sys; from survey.programs import run; run()"

        def measure(quick):
            """Measure."""
            return Grid(drawn()).cells(), COMMAND, PROGRAM
        ''',
    "survey/__init__.py": "from survey.lazy import attach\n__getattr__ = attach(__name__)\n",
    "survey/__init__.pyi": "from survey.grid import Grid as Grid\n",
    "survey/lazy.py": "def attach(name):\n    return name\n",
    "survey/grid.py": '''
        import numpy as np
        class Grid:
            """A grid."""
            def __init__(self, z):
                self.z = z
            def cells(self):
                return np.abs(self.z)
            def area(self):
                return other(self.z)
        def other(z):
            return z
        ''',
    "survey/noise.py": """
        SIGMA = 1.0  # metres
        def drawn():
            return SIGMA
        def unused():
            return 2
        """,
    "survey/programs.py": "def run():\n    return 1\n",
    "firnline/cli/planning.py": "def plan():\n    return 1\ndef score():\n    return 2\n",
    "firnline/cli/main.py": "from firnline.cli import planning\n",
    "papers/provenance.py": "KEY = 1\n",
}


def digest_of(place, files):
    """Write a checkout and return the digest of the benchmark."""
    for name, text in files.items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(dedent(text))
    return Code.of_checkout(place).digest(START)


@pytest.fixture
def digest(tmp_path):
    """Return a function that gives the digest with some texts replaced, each in one file."""

    def changed(*replacements):
        files = dict(FILES)
        for name, old, new in replacements:
            assert old in files[name]
            files[name] = files[name].replace(old, new)
        return digest_of(tmp_path, files)

    return changed


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("survey/noise.py", "1.0", "1.5"),
        ("survey/grid.py", "np.abs(self.z)", "np.abs(self.z, self.z)"),
        ("survey/grid.py", "import numpy as np", "import cupy as np"),
        ("survey/grid.py", "self.z = z", "self.z = -z"),
        ("survey/lazy.py", "return name", "return name + name"),
        ("survey/programs.py", "return 1", "return 3"),
        ("firnline/cli/planning.py", "return 1", "return 3"),
        ("benchmarks/heights.py", "site.geojson", "other.geojson"),
    ],
)
def test_what_the_function_reaches_changes_its_digest(digest, file, old, new):
    assert digest() != digest((file, old, new))


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("survey/noise.py", "return 2", "return 3"),
        ("survey/noise.py", "# metres", "# millimetres"),
        ("survey/grid.py", '"""A grid."""', '"""Another text."""'),
        ("survey/grid.py", "return other(self.z)", "return 2 * other(self.z)"),
        ("survey/grid.py", "    return z\n", "    return 2 * z\n"),
        ("firnline/cli/planning.py", "return 2", "return 3"),
        ("papers/provenance.py", "1", "2"),
    ],
)
def test_what_it_does_not_reach_leaves_its_digest(digest, file, old, new):
    assert digest() == digest((file, old, new))


def test_a_moved_module_leaves_the_digest(tmp_path):
    files = {
        name.replace("noise", "draws"): text.replace("survey.noise", "survey.draws")
        for name, text in FILES.items()
    }
    assert digest_of(tmp_path / "before", FILES) == digest_of(tmp_path / "after", files)


def test_a_method_counts_once_its_name_is_asked_for(digest):
    asked = ("benchmarks/heights.py", "cells()", "area()")
    changed = ("survey/grid.py", "return other(self.z)", "return 2 * other(self.z)")
    assert digest(asked) != digest(asked, changed)


def test_a_function_that_is_not_there_has_no_digest(tmp_path):
    digest_of(tmp_path, FILES)
    assert Code.of_checkout(tmp_path).digest("benchmarks.heights:main") is None
    assert Code.of_checkout(tmp_path).digest("benchmarks.other:measure") is None
